"""The forms of mappings that are objects of classes with declared fields."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from ff_planner_ros.common.declared import declared, fields_of, read_keys, schema_of, written_object
from ff_planner_ros.common.declared_messages import values_in
from ff_planner_ros.common.forms import Form
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
    """Return the form of a mapping of some fields of a class: by name, what is to be changed."""

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
        written=written_object,
        from_message=lambda field, message: values_in(kind, message, field),
        of=kind,
    )
