"""Strict readers of values in YAML, JSON and Python; errors name the key or argument."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import Faults, InvalidInput, Status

Kind = TypeVar("Kind")


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
    """Return `value` as a list if it is a list or tuple.

    Raises:
        InvalidInput: Neither.
    """
    if not isinstance(value, list | tuple):
        raise InvalidInput(Status.WRONG_SIZE, field, quoted(value), "it must be a list")
    return list(value)


def numbers(field: str, value: object) -> Array:
    """Return `value` as an array of shape (entries,) if it is a list of numbers.

    Raises:
        InvalidInput: Not a list, or an entry that is not a number.
    """
    entries = sequence(field, value)
    return np.array([number(f"{field}[{index}]", entry) for index, entry in enumerate(entries)])


def rows(field: str, value: object) -> list[Array]:
    """Return `value` as arrays if it is a list of lists of numbers.

    Raises:
        InvalidInput: Not a list, or an entry that is no list of numbers.
    """
    faults, found = Faults(), list[Array]()
    for index, row in enumerate(sequence(field, value)):
        with faults.gathered():
            found.append(numbers(f"{field}[{index}]", row))
    faults.refuse()
    return found


def number(field: str, value: object) -> float:
    """Return `value` if it is a number.

    Raises:
        InvalidInput: Not a number.
    """
    if not isinstance(value, bool) and isinstance(value, Real):
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
    if isinstance(value, bool) or not isinstance(value, Integral):
        allowed = "it must be a whole number"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
    return int(value)


def boolean(field: str, value: object) -> bool:
    """Return `value` if it is true or false.

    Raises:
        InvalidInput: Neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), "it must be true or false")
    return bool(value)


def text(field: str, value: object) -> str:
    """Return `value` if it is text.

    Raises:
        InvalidInput: Not text, or empty.
    """
    if found := any_text(field, value):
        return found
    raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), "it must be text, and not empty")


def any_text(field: str, value: object) -> str:
    """Return `value` if it is text, which may be empty.

    Raises:
        InvalidInput: Not text.
    """
    if not isinstance(value, str):
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), "it must be text")
    return value


def an_object(field: str, value: object, *kinds: type[Kind]) -> Kind:
    """Return `value` if it is an object of one of these classes.

    Raises:
        InvalidInput: It is not.
    """
    if isinstance(value, kinds):
        return value
    named = " or ".join(kind.__name__ for kind in kinds)
    raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), f"it must be a {named}")


def dotted(field: str, key: object) -> str:
    """Return the name of `key` inside `field`."""
    return f"{field}.{key}" if field else str(key)


def of_checked(kind: type[Kind], /, **values: Any) -> Kind:
    """Return a frozen dataclass of values that have been checked: a thousand spheres are many.

    Args:
        **values: Of all fields, arrays read-only.
    """
    made = object.__new__(kind)
    made.__dict__.update(values)
    return made
