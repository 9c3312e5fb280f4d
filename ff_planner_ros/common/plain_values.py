"""Strict readers of values in YAML and JSON files; errors name the key."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import Faults, InvalidInput, Status


def mapping(
    field: str, value: object, required: Collection[str], optional: Collection[str] = ()
) -> dict[str, Any]:
    """Return `value` if it is a mapping with the right keys; field: empty for the whole file.

    Raises:
        InvalidInput: Not a mapping, or keys that are unknown or missing: it names them all.
    """
    known = [*required, *optional]
    if not isinstance(value, dict):
        raise InvalidInput(
            Status.OUT_OF_RANGE, field or "file", value, f"it must hold {', '.join(known)}"
        )
    faults = Faults()
    for key in value:
        if key not in known:
            faults.add(dotted(field, key), "unknown", f"known are {', '.join(known)}")
    for key in required:
        if key not in value:
            faults.add(dotted(field, key), "missing", "it must be given")
    faults.refuse()
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
