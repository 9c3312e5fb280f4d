"""YAML files read strictly: keys that are unknown, missing or given twice are refused by name."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.shown import quoted, shortened
from ff_planner_ros.text_file import read_text

# A scenario with a running plan of ten thousand points for seven joints has 240,000 values in
# 5 MB. Whatever is larger would take seconds and hundreds of megabytes only to be refused.
_MOST_BYTES, _MOST_VALUES = 10_000_000, 250_000
_DEEPEST = 32  # lists and mappings within each other; ours have five
_LONGEST_NUMBER = 400  # [characters] enough for each that Python can hold
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_LONGEST_REASON = 400  # [characters] of what the library says
# That of libyaml is ten times as fast; not every system has it.
_Fast: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(path: Path) -> Any:
    """Return the document in a YAML file.

    Raises:
        InvalidInput: The file cannot be read or is not YAML.
    """
    return yaml_document(read_text(path, _MOST_BYTES), "file", path)


def yaml_document(written: str | bytes, field: str, value: object) -> Any:
    """Return a YAML document.

    Args:
        written: YAML, UTF-8 if it is bytes.
        field: As the message names the document.
        value: As the message shows it.

    Raises:
        InvalidInput: It is not YAML, or too large or too deep to be one of ours.
    """
    try:
        if len(written) > _MOST_BYTES:
            raise _TooMuch(None, None, f"it must not be larger than {_MOST_BYTES / 1e6:g} MB")
        text = written.decode() if isinstance(written, bytes) else written
        _require_moderate(text)
        return yaml.load(text, Loader=_Loader)
    except _TooMuch as error:
        reason = str(error)
    except (yaml.YAMLError, ValueError) as error:
        reason = f"it is not YAML: {shortened(str(error), _LONGEST_REASON)}"
    reason = reason.replace('in "<unicode string>", ', "in ")
    raise InvalidInput(Status.OUT_OF_RANGE, field, value, reason)


def _require_moderate(text: str) -> None:
    """Refuse a document that is too deep or too large, with what its aliases stand for.

    Raises:
        Exception: It is, or it is not YAML.
    """
    values = 0  # so far, those that aliases stand for counted
    begun: list[tuple[str | None, int]] = []  # of what is open: its anchor, values before it
    sizes: dict[str | None, int] = {}  # values that an anchor stands for
    for event in yaml.parse(text, Loader=_Fast):
        if isinstance(event, yaml.NodeEvent):
            values += 1
        if isinstance(event, yaml.AliasEvent):
            values += _size(event, sizes)
        elif isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, values))
            sizes.pop(event.anchor, None)  # it stands for something else from here on
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            sizes[anchor] = values - before + 1
        elif isinstance(event, yaml.ScalarEvent):
            sizes[event.anchor] = 1
        if len(begun) > _DEEPEST:
            raise _too_much(f"its lists are deeper than {_DEEPEST}", event)
        if values > _MOST_VALUES:
            raise _too_much(f"it holds more than {_MOST_VALUES} values", event)


def _size(alias: yaml.AliasEvent, sizes: Mapping[str | None, int]) -> int:
    if alias.anchor not in sizes:
        mark: Any = alias.start_mark
        reason = f"the alias {quoted(alias.anchor)} stands for nothing, or for itself"
        raise yaml.MarkedYAMLError(None, None, reason, mark)
    return sizes[alias.anchor]


def _too_much(reason: str, at: Any) -> _TooMuch:
    return _TooMuch(None, None, reason, at.start_mark)


class _TooMuch(yaml.MarkedYAMLError):
    """A document that is YAML, but too large or too deep."""


def mapping(
    field: str, value: object, required: Collection[str], optional: Collection[str] = ()
) -> dict[str, Any]:
    """Return `value` if it is a mapping with the right keys; field: empty for the whole file.

    Raises:
        InvalidInput: Not a mapping, a key unknown or missing.
    """
    known = [*required, *optional]
    if not isinstance(value, dict):
        raise InvalidInput(
            Status.OUT_OF_RANGE, field or "file", value, f"it must hold {', '.join(known)}"
        )
    for key in value:
        if key not in known:
            raise InvalidInput(
                Status.OUT_OF_RANGE, dotted(field, key), "unknown", f"known are {', '.join(known)}"
            )
    for key in required:
        if key not in value:
            raise InvalidInput(
                Status.OUT_OF_RANGE, dotted(field, key), "missing", "it must be given"
            )
    return value


def sequence(field: str, value: object) -> list[Any]:
    """Return `value` if it is a list.

    Raises:
        InvalidInput: Not a list.
    """
    if not isinstance(value, list):
        raise InvalidInput(Status.WRONG_SIZE, field, quoted(value), "it must be a list")
    return value


def numbers(field: str, value: object) -> Array:
    """Return `value` as an array of shape (entries,) if it is a list of numbers.

    Raises:
        InvalidInput: Not a list, or an entry that is not a number.
    """
    entries = sequence(field, value)
    return np.array([number(f"{field}[{index}]", entry) for index, entry in enumerate(entries)])


def number(field: str, value: object) -> float:
    """Return `value` if it is a number.

    Raises:
        InvalidInput: Not a number.
    """
    if not isinstance(value, bool) and isinstance(value, int | float):
        with suppress(OverflowError):
            return float(value)
    # YAML reads 1e-3 as text: its numbers need the point.
    allowed = "it must be a number, such as 1.0e-3"
    raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)


def integer(field: str, value: object) -> int:
    """Return `value` if it is a whole number.

    Raises:
        InvalidInput: Not a whole number.
    """
    if isinstance(value, bool) or not isinstance(value, int):
        allowed = "it must be a whole number"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
    return value


def boolean(field: str, value: object) -> bool:
    """Return `value` if it is true or false.

    Raises:
        InvalidInput: Neither.
    """
    if not isinstance(value, bool):
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), "it must be true or false")
    return value


def text(field: str, value: object) -> str:
    """Return `value` if it is text.

    Raises:
        InvalidInput: Not text, or empty.
    """
    if not isinstance(value, str) or not value:
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), "it must be text")
    return value


def dotted(field: str, key: object) -> str:
    """Return the name of `key` inside `field`."""
    return f"{field}.{key}" if field else str(key)


class _Loader(_Fast):  # type: ignore[misc]
    """The safe loader, minus silence about a key given twice, where the last would win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {quoted(key.value)} is there twice", key.start_mark
                )
            seen.add(key.value)
        mapping: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return mapping

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if node.tag in _NUMBERS and len(node.value) > _LONGEST_NUMBER:
            raise _too_much(f"a number is longer than {_LONGEST_NUMBER} characters", node)
        try:
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except Exception as error:  # a month 13, `!!int x`: the library trips over what it is
            makes_no_sense = f"{quoted(node.value)} makes no sense as {node.tag}"
            reason = str(error) if isinstance(error, ValueError) else makes_no_sense
            raise yaml.MarkedYAMLError(None, None, reason, node.start_mark) from None
