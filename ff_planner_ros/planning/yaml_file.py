"""YAML files read strictly: keys that are unknown, missing or given twice are refused by name."""

from __future__ import annotations

from collections.abc import Collection, Hashable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status


def read_yaml(path: Path) -> Any:
    """Return the document in a YAML file.

    Raises:
        InvalidInput: The file cannot be read or is not YAML.
    """
    try:
        with path.open(encoding="utf-8") as stream:
            return yaml.load(stream, Loader=_Loader)
    except OSError as error:
        reason = f"it cannot be read: {error.strerror}"
    except (yaml.YAMLError, ValueError) as error:
        reason = f"it is not YAML: {error}"
    raise InvalidInput(Status.OUT_OF_RANGE, "file", path, reason)


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
        raise InvalidInput(Status.WRONG_SIZE, field, repr(value), "it must be a list")
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
    raise InvalidInput(Status.OUT_OF_RANGE, field, repr(value), allowed)


def integer(field: str, value: object) -> int:
    """Return `value` if it is a whole number.

    Raises:
        InvalidInput: Not a whole number.
    """
    if isinstance(value, bool) or not isinstance(value, int):
        allowed = "it must be a whole number"
        raise InvalidInput(Status.OUT_OF_RANGE, field, repr(value), allowed)
    return value


def boolean(field: str, value: object) -> bool:
    """Return `value` if it is true or false.

    Raises:
        InvalidInput: Neither.
    """
    if not isinstance(value, bool):
        raise InvalidInput(Status.OUT_OF_RANGE, field, repr(value), "it must be true or false")
    return value


def text(field: str, value: object) -> str:
    """Return `value` if it is text.

    Raises:
        InvalidInput: Not text, or empty.
    """
    if not isinstance(value, str) or not value:
        raise InvalidInput(Status.OUT_OF_RANGE, field, repr(value), "it must be text")
    return value


def dotted(field: str, key: object) -> str:
    """Return the name of `key` inside `field`."""
    return f"{field}.{key}" if field else str(key)


class _Loader(yaml.SafeLoader):
    """The safe loader, minus silence about a key given twice, where the last would win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key '{key.value}' is there twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)
