"""YAML files read strictly: what is too large, or given twice, is refused."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import yaml

from ff_planner_ros.common.shown import quoted, shortened
from ff_planner_ros.common.text_file import read_text
from ff_planner_ros.errors import InvalidInput, InvalidInputs, Status

# A scenario with a running plan of ten thousand points for seven joints has 240,000 values in
# 5 MB. Whatever is larger would take seconds and hundreds of megabytes only to be refused.
MOST_BYTES, _MOST_VALUES = 10_000_000, 250_000
_DEEPEST = 32  # lists and mappings within each other; ours have five
_LONGEST_NUMBER = 400  # [characters] enough for each that Python can hold
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_LONGEST_REASON = 400  # [characters] of what the library says
_STEP = re.compile(r"\[([^\]]*)\]|([^.\[\]]+)")  # of a field: `obstacles[1].center`
# That of libyaml is ten times as fast; not every system has it.
_Fast: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(path: Path) -> Any:
    """Return the document in a YAML file.

    Raises:
        InvalidInput: The file cannot be read or is not YAML.
    """
    return yaml_document(read_text(path, MOST_BYTES), "file", path)


def yaml_document(written: str | bytes, field: str, value: object) -> Any:
    """Parse a YAML document.

    Args:
        written: YAML, UTF-8 if it is bytes.
        field: Name of the document in errors.
        value: What errors show in its place.

    Raises:
        InvalidInput: It is not YAML, or too large or too deep to be one of ours.
    """
    try:
        if len(written) > MOST_BYTES:
            raise _TooMuch(None, None, f"it must not be larger than {MOST_BYTES / 1e6:g} MB")
        text = written.decode() if isinstance(written, bytes) else written
        _require_moderate(text)
        return yaml.load(text, Loader=_Loader)
    except _TooMuch as error:
        reason = str(error)
    except (yaml.YAMLError, ValueError) as error:
        reason = f"it is not YAML: {shortened(str(error), _LONGEST_REASON)}"
    reason = reason.replace('in "<unicode string>", ', "in ")
    raise InvalidInput(Status.OUT_OF_RANGE, field, value, reason)


def located(path: Path, error: InvalidInput) -> InvalidInputs:
    """Return an error of a YAML file whose faults name the file, and the line of each.

    A key that is missing has the line of what it is missing in.
    """
    lines = _Lines(path)
    return InvalidInputs(
        [
            InvalidInput(
                one.status, f"{lines.place(one.field)}: {one.field}", one.value, one.allowed
            )
            for one in error.faults
        ]
    )


class _Lines:
    """Where the values of a YAML file stand."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._root: Any = yaml.compose(read_text(path, MOST_BYTES), Loader=_Fast)
        except (yaml.YAMLError, ValueError, InvalidInput):
            self._root = None

    def place(self, field: str) -> str:
        """Return file and line of a value; the file alone where it has no such line."""
        node, line = self._root, 0
        for index, key in _STEP.findall(field):
            mark, node = _entry(node, index or key)
            if mark is None:
                break
            line = mark.line + 1
        return f"{self._path}:{line}" if line else str(self._path)


def _entry(node: Any, name: str) -> tuple[Any, Any]:
    """Return where an entry begins, and its value; None: there is none."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == name:
                return key.start_mark, value
    elif isinstance(node, yaml.SequenceNode):
        for index, one in enumerate(node.value):
            if str(index) == name or getattr(_entry(one, "id")[1], "value", None) == name:
                return one.start_mark, one
    return None, None


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
