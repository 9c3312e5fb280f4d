"""Declared fields in messages: their paths, and how their values are read and written."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sized
from dataclasses import MISSING, is_dataclass
from functools import cache
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np

from ff_planner_ros.common.declared import DeclaredField, declared, inlined
from ff_planner_ros.common.plain_values import dotted

_attribute = cache(attrgetter)
# Behind the name of an array of at most one entry: what is in it.
_ENTRY = "[0]"


def value_at(message: Any, path: str, lacking: Any = MISSING) -> Any:
    """Return the value at a dotted path of a message, or `lacking` if there is none.

    A message of another definition may lack a field, and an array that holds `name[0]` be empty.

    Raises:
        AttributeError: There is none, and `lacking` is not given.
    """
    try:
        return _getter(path)(message) if path else message
    except AttributeError:
        if lacking is MISSING:
            raise
        return lacking


@cache
def _getter(path: str) -> Callable[[Any], Any]:
    """Return what takes a dotted place out of a message; it raises AttributeError."""
    if _ENTRY not in path:
        return _attribute(path)
    array, _, rest = path.partition(_ENTRY)

    def value(message: Any) -> Any:
        entries = _attribute(array)(message)
        if not len(entries):
            raise AttributeError(f"{array} is empty")
        return value_at(entries[0], rest.removeprefix("."))

    return value


def values_in(
    kind: Any, message: Any, field: str = "", names: Container[str] | None = None
) -> dict[str, Any]:
    """Return the values of a class's declared fields in a message, by field name.

    A field with a default is omitted where the message lacks it, and where it is empty there
    although the default is not: a number or vector of zero, no text, no entries.

    Args:
        field: Prefix of the keys in errors.
        names: Fields to read; None: all.

    Raises:
        AttributeError: The message lacks a field that has no default.
        InvalidInput: A value is refused; the field is named as in files.
    """
    found: dict[str, Any] = {}
    for key, one in declared(kind).items():
        if one.message is None or "." in one.name or not (names is None or one.name in names):
            continue
        try:
            part = value_at(message, one.message)
            if not one.empties or _says_something(one, part):
                value = _attribute(*one.form.slots)(part) if one.form.slots else part
                found[one.name] = one.form.from_message(dotted(field, key), value)
        except AttributeError:
            if one.default is MISSING:
                raise
    for name, part in inlined(kind).items():
        if (told := values_in(part, message, field)) or not hasattr(kind, name):
            found[name] = part(**told)
    return found


def _says_something(one: DeclaredField, part: Any) -> bool:
    """Tell whether a part of a message does; None: the message lacks it."""
    if part is None:
        return False
    if one.message is not None and one.message.endswith(_ENTRY):
        return True
    if one.form.of is not None:
        return any(
            inner.message is not None
            and _says_something(inner, value_at(part, inner.message, None))
            for inner in declared(one.form.of).values()
        )
    if one.form.slots:
        return any(_attribute(*one.form.slots)(part))
    return bool(len(part) if isinstance(part, Sized) else part)


def places_in(
    kind: Any, block: str = "", place: str = ""
) -> Iterator[tuple[str, str, DeclaredField]]:
    """Yield key, message path and declaration of each declared value, those of parts included.

    Args:
        block: Prefix of the keys.
        place: Path of the class's message within the outer message.
    """
    for key, one in declared(kind).items():
        if one.message is not None:
            here, there = dotted(block, key), ".".join(filter(None, (place, one.message)))
            if one.form.of is None:
                yield here, there, one
            else:
                yield from places_in(one.form.of, here, there)


def names_in(kind: Any, block: str = "", place: str = "") -> dict[str, str]:
    """Return the message path of each file key, as `fields_named` takes it, to rename errors.

    Args:
        block: Prefix of the keys.
        place: Prefix of the paths.
    """
    return {
        dotted(block, key): ".".join(filter(None, (place, path)))
        for key, path in _paths(kind).items()
    }


@cache  # a scene asks for each of a thousand spheres
def _paths(kind: Any) -> dict[str, str]:
    paths = {key: path for key, path, _ in places_in(kind)}
    for key, one in declared(kind).items():
        if one.message is not None and one.form.of is not None:
            paths[key] = one.message
    # What may be absent is not counted; what the place of the message counts is one of many.
    return {key: path.replace(_ENTRY, "") for key, path in paths.items()}


# Makes a new entry for an array of a message, given the message and the array's name.
Entry: TypeAlias = Callable[[Any, str], Any]


def write_object(value: Any, message: Any, entry: Entry) -> Any:
    """Write an object's declared fields into a message, and return it; None is not written."""
    for one in declared(type(value)).values():
        given = None if one.message is None else value_at(value, one.name)
        if given is None or one.message is None:
            continue
        if is_dataclass(given):
            write_object(given, _part(message, one.message, entry), entry)
        elif isinstance(given, tuple) and given and all(map(is_dataclass, given)):
            parts = [write_object(part, entry(message, one.message), entry) for part in given]
            write_value(message, one, parts, entry)
        elif not one.brief or not _same(given, one.default):
            write_value(message, one, one.form.written(given), entry)
    return message


def _same(given: Any, usual: Any) -> bool:
    return bool(np.array_equal(given, usual))


def write_value(message: Any, one: DeclaredField, plain: Any, entry: Entry, path: str = "") -> None:
    """Write a value, as a file has it, to its path in a message.

    The word `none` empties an array of at most one entry; elsewhere it is written as zero or empty.
    """
    path = path or one.message or ""
    place, _, name = path.rpartition(".")
    nothing = one.form.spells_none and plain == "none"
    if name.endswith(_ENTRY) and not one.form.slots:
        held = [] if nothing else [one.form.to_message(plain)]
        setattr(_part(message, place, entry), name.removesuffix(_ENTRY), held)
        return
    holder = _part(message, place, entry)
    present = _part(holder, name, entry)
    if one.form.slots:
        numbers = plain.values() if isinstance(plain, dict) else plain
        for slot, number in zip(one.form.slots, numbers, strict=True):
            setattr(present, slot, number)
    else:
        setattr(holder, name, present * 0 if nothing else one.form.to_message(plain))


def _part(message: Any, path: str, entry: Entry) -> Any:
    """Return a part of a message; the entries that lead to it are made where there are none."""
    array, found, rest = path.partition(_ENTRY)
    if not found:
        return value_at(message, path)
    place, _, name = array.rpartition(".")
    holder = value_at(message, place)
    if not value_at(holder, name):
        setattr(holder, name, [entry(holder, name)])
    return _part(value_at(holder, name)[0], rest.removeprefix("."), entry)
