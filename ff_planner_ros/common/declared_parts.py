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


def one_of_parts(key: str, with_key: Form, without: Form) -> Form:
    """Return the form of an object of one of two classes.

    Args:
        key: Key by which files tell the first class from the second.
        with_key: Form of the first class.
        without: Form of the second class. Messages hold the classes in separate arrays: only its
            entries are read.
    """
    kinds = [form.of for form in (with_key, without) if form.of is not None]

    def of(value: Any) -> Form:
        if isinstance(value, dict):
            return with_key if key in value else without
        return with_key if with_key.of is type(value) else without

    return Form(
        lambda field, value: of(value).read(field, value),
        lambda: {"anyOf": [without.schema(), with_key.schema()]},
        lambda field, value: an_object(field, value, *kinds),
        lambda value: of(value).written(value),
        from_message=without.from_message,
    )
