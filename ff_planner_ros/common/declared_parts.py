"""Forms of nested mappings: each stands for an object of a class with declared fields."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from ff_planner_ros.common.declared import declared, fields_of, read_keys, schema_of, written_object
from ff_planner_ros.common.declared_messages import values_in
from ff_planner_ros.common.forms import Form
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.errors import Faults

_IN_LIST = re.compile(r"\[\d+\]$")


def part(kind: type[Any]) -> Form:
    """Return the form of a mapping that is an object of a class with declared fields."""
    given = changes(kind)
    return replace(
        given,
        read=lambda field, value: kind(**given.read(field, value)),
        from_message=lambda field, message: kind(**values_in(kind, message, field)),
    )


def changes(kind: type[Any]) -> Form:
    """Return the form of a mapping with some of a class's fields, read as values by field name."""

    def read(field: str, value: object) -> dict[str, Any]:
        name = value.get("id") if isinstance(value, dict) else None
        named = _IN_LIST.sub(lambda _: f"[{name}]", field) if isinstance(name, str) else field
        faults = Faults()
        found = read_keys(declared(kind), field, value, faults, named)
        faults.refuse()
        return fields_of(kind, found)

    return Form(
        read,
        lambda: schema_of(declared(kind)),
        lambda field, value: an_object(field, value, kind),
        written_object,
        from_message=lambda field, message: values_in(kind, message, field),
        of=kind,
    )


def part_or_entry(key: str, kind: type[Any], entry: type[Any]) -> Form:
    """Return the form of an object that files may give in a second way, messages in that alone.

    Args:
        key: Key of the first way, by which files tell it from the second.
        kind: Class of the object, with the declared fields of the first way.
        entry: Class with those of the second: `made()` returns the object, `entry.of(object)` its
            entry; for objects that are spheres.
    """
    usual, second = part(kind), part(entry)

    def read(field: str, value: object) -> Any:
        if isinstance(value, dict) and key in value:
            return usual.read(field, value)
        return second.read(field, value).made()

    return Form(
        read,
        lambda: {"anyOf": [second.schema(), usual.schema()]},
        lambda field, value: an_object(field, value, kind),
        lambda value: written_object(entry.of(value) if value.is_sphere else value),
        from_message=lambda field, message: second.from_message(field, message).made(),
    )
