"""The forms of declared values: how a file spells them, what is allowed, and their JSON Schema."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Real
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import (
    Array,
    finite_number,
    finite_vector,
    normalising_to,
    symmetric_tensor,
    unit_quaternion,
    unit_vector,
)
from ff_planner_ros.common.plain_values import (
    any_text,
    boolean,
    integer,
    mapping,
    number,
    numbers,
    rows,
    sequence,
    text,
)
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import Faults, InvalidInput, Status

Schema: TypeAlias = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"  # of JSON Schema


@dataclass(frozen=True)
class Form:
    """What a value may be, and how it is converted; errors, InvalidInput, name its field."""

    read: Callable[[str, object], Any]  # from a file's value
    schema: Callable[[], Schema]  # of a file's value
    checked: Callable[[str, Any], Any] = lambda _field, value: value  # as its class stores it
    written: Callable[[Any], Any] = lambda value: value  # as a file has it
    absent: Status = Status.OUT_OF_RANGE  # of the error if the value is missing
    spells_none: bool = False  # whether a file has a word for None
    # Fields of the part of a message that holds it; none: a number, text or list of the message
    slots: tuple[str, ...] = ()
    # From a message's value, or from its slots' values
    from_message: Callable[[str, Any], Any] = lambda _field, value: value
    # From a value as a file has it
    to_message: Callable[[Any], Any] = lambda plain: plain
    of: type[Any] | None = None  # class whose declared fields it holds


def of_numbers(size: int | None = None) -> Schema:
    """Return the JSON Schema of a list of `size` numbers; None: of any number."""
    bounds = {} if size is None else {"minItems": size, "maxItems": size}
    return {"type": "array", "items": {"type": "number"}} | bounds


def of_mapping(properties: Mapping[str, Schema]) -> Schema:
    """Return the JSON Schema of a mapping that has all of these keys and no others."""
    schema = {"type": "object", "properties": dict(properties), "required": list(properties)}
    return schema | {"additionalProperties": False}


def a_number(
    above: float | None = None, at_least: float | None = None, at_most: float | None = None
) -> Form:
    """Return the form of a finite number within bounds."""
    bounds = {"exclusiveMinimum": above, "minimum": at_least, "maximum": at_most}
    words = (("at least", at_least), ("at most", at_most))
    allowed = "be " + " and ".join(f"{word} {at:g}" for word, at in words if at is not None)
    if at_least == 0.0 and at_most is None:
        allowed = "not be negative"
    low = -math.inf if at_least is None else at_least
    high = math.inf if at_most is None else at_most

    def checked(field: str, value: Any) -> float:
        found = finite_number(field, number(field, value), above=above)
        if not low <= found <= high:
            raise InvalidInput(Status.OUT_OF_RANGE, field, found, f"it must {allowed}")
        return found

    schema = {"type": "number"} | {key: at for key, at in bounds.items() if at is not None}
    return Form(number, lambda: schema, checked, float)


def a_whole_number(least: int, most: int | None = None) -> Form:
    """Return the form of a whole number within bounds."""

    def checked(field: str, value: Any) -> int:
        if not least <= integer(field, value) <= (math.inf if most is None else most):
            words = f"{least} or more" if most is None else f"from {least} to {most}"
            raise InvalidInput(Status.OUT_OF_RANGE, field, value, f"it must be {words}")
        return int(value)

    schema = {"type": "integer", "minimum": least} | ({} if most is None else {"maximum": most})
    return Form(integer, lambda: schema, checked)


def a_word(words: Iterable[str]) -> Form:
    """Return the form of a choice between words, or between the members of an enumeration."""

    def read(field: str, value: object) -> str:
        given = value if isinstance(value, str) else None
        for word in words:
            if given == word:
                return word
        *others, last = words
        allowed = f"it must be {', '.join(others)} or {last}"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)

    schema = {"enum": [str(word) for word in words]}
    return Form(read, lambda: schema, read, str, from_message=read)


def a_numbered_word(words: type[StrEnum]) -> Form:
    """Return the form of an enumeration's words; messages hold their index."""
    form, numbered = a_word(words), tuple(words)

    def from_message(field: str, value: int) -> str:
        if 0 <= value < len(numbered):
            return numbered[value]
        named = ", ".join(f"{number} ({word})" for number, word in enumerate(numbered))
        raise InvalidInput(Status.OUT_OF_RANGE, field, value, f"it must be one of {named}")

    return replace(form, from_message=from_message, to_message=numbered.index)


def a_vector(size: int | None = 3) -> Form:
    """Return the form of a list of `size` finite numbers; None: of any number."""

    def checked(field: str, value: Any) -> Array:
        return finite_vector(field, value, _size(value) if size is None else size)

    slots = tuple("xyz") if size == 3 else ()
    return Form(numbers, lambda: of_numbers(size), checked, _as_list, slots=slots)


def by_name(of: str) -> Form:
    """Return the form of a mapping from names to numbers; of: whose names, in errors."""

    def read(field: str, value: object) -> dict[str, float]:
        if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
            allowed = f"it must hold a position for each name of {of}"
            raise InvalidInput(Status.OUT_OF_RANGE, field, value, allowed)
        named = {f"{field}.{name}": (name, given) for name, given in value.items()}
        return {name: finite_number(at, number(at, one)) for at, (name, one) in named.items()}

    return Form(read, lambda: {"type": "object", "additionalProperties": {"type": "number"}}, read)


def each(of: Form, least: int = 0, unique: str = "id") -> Form:
    """Return the form of a tuple of values of one form.

    Args:
        least: Smallest number of values, 0 or 1.
        unique: Key whose value must differ between mappings that have it.
    """

    def read(field: str, value: object) -> tuple[Any, ...]:
        faults, found, names = Faults(), [], set[str]()
        for index, one in enumerate(entries := sequence(field, value)):
            place = f"{field}[{index}]"
            with faults.gathered():
                found.append(of.read(place, one))
            name = one.get(unique) if isinstance(one, dict) else None
            if isinstance(name, str):
                if name in names:
                    faults.add(f"{place}.{unique}", name, "it must be unique")
                names.add(name)
        faults.refuse()
        if len(entries) < least:
            raise InvalidInput(Status.WRONG_SIZE, field, "empty", "it must have one entry or more")
        return tuple(found)

    def checked(field: str, value: object) -> tuple[Any, ...]:
        entries = enumerate(sequence(field, value))
        return tuple(of.checked(f"{field}[{index}]", one) for index, one in entries)

    def written(value: Any) -> list[Any]:
        return [of.written(one) for one in value]

    def from_message(field: str, value: Any) -> tuple[Any, ...]:
        return tuple(of.from_message(f"{field}[{index}]", one) for index, one in enumerate(value))

    def schema() -> Schema:
        bounds = {"minItems": least} if least else {}
        return {"type": "array", "items": of.schema()} | bounds

    return Form(read, schema, checked, written, from_message=from_message)


def or_none(form: Form, none: Any = None) -> Form:
    """Return the form of a value of `form` or the word `none`, which stands for `none`."""

    def is_none(value: Any) -> bool:
        return value is None or (isinstance(value, str | float) and value in ("none", none))

    def read(field: str, value: Any) -> Any:
        if value == "none":
            return none
        if isinstance(none, float) and value == none:  # spelled as a number, it is a mistake
            raise InvalidInput(Status.NOT_FINITE, field, value, "it must be finite, or none")
        return either(form.read, field, value)

    def either(reader: Callable[[str, Any], Any], field: str, value: Any) -> Any:
        try:
            return reader(field, value)
        except InvalidInput as error:
            if error.field != field or len(error.faults) > 1:
                raise
            allowed = f"{error.allowed}, or none"
            raise InvalidInput(error.status, field, error.value, allowed) from None

    return Form(
        read,
        lambda: {"anyOf": [{"const": "none"}, form.schema()]},
        lambda field, value: none if is_none(value) else either(form.checked, field, value),
        lambda value: "none" if is_none(value) else form.written(value),
        spells_none=True,
        slots=form.slots,
        from_message=form.from_message,
    )


def or_part(form: Form, whole: Form) -> Form:
    """Return the form of a value of `form`, or of an object of `whole`, a mapping in files."""

    def of(value: object) -> Form:
        return whole if isinstance(value, dict | whole.of) else form

    return Form(
        lambda field, value: of(value).read(field, value),
        lambda: {"anyOf": [form.schema(), whole.schema()]},
        lambda field, value: of(value).checked(field, value),
        lambda value: of(value).written(value),
    )


def a_source(*words: str) -> Form:
    """Return the form of whether limits are those of the URDF: true for the first word."""

    def read(field: str, value: object) -> bool:
        if value not in words:
            allowed = f"it must be {' or '.join(words)}"
            raise InvalidInput(Status.UNSUPPORTED, field, value, allowed)
        return value == words[0]

    schema = {"enum": list(words)}
    return Form(read, lambda: schema, boolean, lambda kept: words[0 if kept else 1])


def _size(value: Any) -> int:
    return len(value) if getattr(value, "ndim", isinstance(value, Sized)) else 1


def _as_list(value: Array) -> list[Any]:
    return list(value.tolist())


def _tensor(_field: str, elements: Iterable[float]) -> Array:
    xx, xy, xz, yy, yz, zz = elements
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _inertia(field: str, value: object) -> Array:
    """Return a tensor, shape (3, 3), of its elements as in a URDF."""
    entry, faults, read = mapping(field, value, _ELEMENTS), Faults(), dict[str, float]()
    for name in _ELEMENTS:
        with faults.gathered():
            read[name] = number(f"{field}.{name}", entry[name])
    faults.refuse()
    return _tensor(field, read.values())


def _one_or_each(field: str, value: object) -> tuple[float, ...]:
    if isinstance(value, list):
        return tuple(numbers(field, value).tolist())
    return (finite_number(field, number(field, value), above=0.0),)


# No motion keeps a smaller limit of an acceleration [rad/s2].
_of_joint = a_number(above=0.0, at_least=1e-9)


def _positive(field: str, value: Any) -> tuple[float, ...]:
    listed = value.tolist() if isinstance(value, np.ndarray) else value
    given = enumerate(sequence(field, [value] if isinstance(value, Real) else listed))
    return tuple(_of_joint.checked(f"{field}[{index}]", limit) for index, limit in given)


_ELEMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ABOVE_ZERO: Schema = {"type": "number", "exclusiveMinimum": 0.0}

TEXT = Form(text, lambda: {"type": "string", "minLength": 1}, text)
NAME = Form(any_text, lambda: {"type": "string"}, any_text, str)  # text that may be empty
TRUTH = Form(boolean, lambda: {"type": "boolean"}, boolean)
# Of unit length to the last bit, and written so that it is read as the same
QUATERNION = Form(
    numbers,
    lambda: of_numbers(4),
    unit_quaternion,
    lambda value: _as_list(normalising_to(value)),
    Status.BAD_QUATERNION,
    slots=tuple("xyzw"),
)
# A vector of any length but zero, kept of unit length
DIRECTION = Form(numbers, lambda: of_numbers(3), unit_vector, _as_list, slots=tuple("xyz"))
INERTIA = Form(
    _inertia,
    lambda: of_mapping({name: {"type": "number"} for name in _ELEMENTS}),
    symmetric_tensor,
    written=lambda value: dict(zip(_ELEMENTS, _as_list(value[np.triu_indices(3)]), strict=True)),
    slots=_ELEMENTS,
    from_message=_tensor,
)
NUMBERS = Form(  # kept as a tuple
    lambda field, value: tuple(numbers(field, value).tolist()),
    of_numbers,
    lambda field, value: tuple(finite_vector(field, value, _size(value)).tolist()),
    list,
)
ROWS = Form(rows, lambda: {"type": "array", "items": of_numbers()}, written=_as_list)
# A positive number for all joints, or one for each; kept as a tuple
ONE_OR_EACH = Form(
    _one_or_each,
    lambda: {"anyOf": [_ABOVE_ZERO, {"type": "array", "items": _ABOVE_ZERO}]},
    _positive,
    list,
    from_message=lambda _field, value: tuple(value),
)
FROM_URDF, ALWAYS_FROM_URDF = a_source("from_urdf", "none"), a_source("from_urdf")
