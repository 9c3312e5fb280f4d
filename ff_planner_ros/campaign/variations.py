"""Variations of a study by keys of a scenario, as in its file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ff_planner_ros.common.forms import Form, Schema, of_mapping
from ff_planner_ros.common.plain_values import mapping, number, sequence
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import Faults, InvalidInput, Status
from ff_planner_ros.planning.scenario.changes import (
    CHOICE,
    NORMAL,
    PLUS,
    SET,
    TIMES,
    UNIFORM,
    Change,
    require_key,
)

RANGE = "range"  # of a grid: from the first to the second number, the third says how many
_DISTRIBUTIONS = (UNIFORM, NORMAL, CHOICE)
# Of a range: more would be made before the cases are counted.
_MOST_VALUES = 10_000
_MOST_VARIED = 500  # values: each is a column of the table
_ANY_LIST: Schema = {"type": "array", "minItems": 1}


def by_key(read: Callable[[str, str, object], Any], written: Any, schema: Schema) -> Form:
    """Return the form of a mapping from keys of a scenario to variations.

    Args:
        read: Returns an entry from its field path, key and value.
        written: Returns key and value of an entry.
        schema: JSON Schema of a value.
    """

    def entries(field: str, value: object) -> tuple[Any, ...]:
        if not isinstance(value, dict):
            allowed = "it must hold values by keys of a scenario, such as planner.starts"
            raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
        if len(value) > _MOST_VARIED:
            allowed = f"a study varies {_MOST_VARIED} at most"
            raise InvalidInput(Status.OUT_OF_RANGE, field, f"{len(value)} keys", allowed)
        faults, found = Faults(), []
        for key, given in value.items():
            with faults.gathered():
                found.append(read(f"{field}.{require_key(field, key)}", key, given))
        faults.refuse()
        return tuple(found)

    return Form(
        entries,
        lambda: {"type": "object", "additionalProperties": schema},
        written=lambda found: dict(map(written, found)),
    )


def _changed_by(schema: Schema) -> Schema:
    """Return the schema of values that replace, multiply or add to the present one."""
    return {"anyOf": [schema, *(of_mapping({how: schema}) for how in (TIMES, PLUS))]}


def _axis(field: str, key: str, given: object) -> tuple[Change, ...]:
    how, values = _how(field, given, (RANGE,))
    if isinstance(values, dict):
        values = _evenly(f"{field}.{RANGE}", mapping(field, values, (RANGE,), (RANGE,))[RANGE])
    return tuple(Change(key, how, one) for one in _list(field, values))


def _evenly(field: str, given: object) -> list[float]:
    """Return evenly spaced values of a range [low, high, count]."""
    numbers = [number(field, one) for one in _list(field, given)]
    low, high, count = numbers if len(numbers) == 3 else (0.0, 0.0, 0.0)
    if not (-1e12 < low < high < 1e12 and count == int(count) and 2 <= count <= _MOST_VALUES):
        allowed = f"it must be [low, high, count], with 2 to {_MOST_VALUES} values"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(given), allowed)
    # A tenth is written as one: what is beyond 12 digits is rounding.
    return [float(f"{one:.12g}") for one in np.linspace(low, high, int(count)).tolist()]


def _drawn(field: str, key: str, given: object) -> tuple[str, str, str, tuple[Any, ...]]:
    how, drawn = _how(field, given, _DISTRIBUTIONS)
    return (key, how, *_distribution(field, drawn))


SET_VALUES = by_key(
    lambda _field, key, given: Change(key, SET, given), lambda one: (one.key, one.value), {}
)
GRID = by_key(
    _axis,
    lambda axis: (axis[0].key, {axis[0].how: [one.value for one in axis]}),
    _changed_by({"anyOf": [_ANY_LIST, of_mapping({RANGE: _ANY_LIST})]}),
)
DRAWN = by_key(
    _drawn,
    lambda one: (one[0], {one[1]: {one[2]: list(one[3])}}),
    _changed_by({"anyOf": [of_mapping({name: _ANY_LIST}) for name in _DISTRIBUTIONS]}),
)


def _how(field: str, given: object, words: tuple[str, ...]) -> tuple[str, Any]:
    """Return whether values replace, multiply or add to the present one, and the values.

    Args:
        words: Other keys that a mapping may have.
    """
    if isinstance(given, dict) and len(given) == 1 and {TIMES, PLUS} & given.keys():
        return next(iter(given.items()))
    if isinstance(given, dict) and not set(words) & given.keys():
        mapping(field, given, (), (TIMES, PLUS, *words))
    return SET, given


def _distribution(field: str, value: object) -> tuple[str, tuple[Any, ...]]:
    entry = mapping(field, value, (), _DISTRIBUTIONS)
    if len(entry) != 1:
        allowed = f"it must be one of {', '.join(_DISTRIBUTIONS)}"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
    ((name, given),) = entry.items()
    parameters = _list(f"{field}.{name}", given)
    if name == CHOICE:
        return name, tuple(parameters)
    numbers = [number(f"{field}.{name}", one) for one in parameters]
    allowed = {
        UNIFORM: "it must be a lower bound and a higher one",
        NORMAL: "it must be a mean and a standard deviation, which is not negative",
    }[name]
    low, high = numbers if len(numbers) == 2 else (0.0, -1.0)
    if not (-1e12 < low < 1e12) or not (low if name == UNIFORM else 0.0) <= high < 1e12:
        raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.{name}", quoted(given), allowed)
    return name, (low, high)


def _list(field: str, value: object) -> list[Any]:
    if not (found := sequence(field, value)):
        raise InvalidInput(Status.WRONG_SIZE, field, "empty", "it must have one entry or more")
    return found
