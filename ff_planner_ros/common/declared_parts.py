"""Forms of nested mappings, each an object of a class with declared fields, and their schema."""

from __future__ import annotations

import re
from dataclasses import MISSING, replace
from typing import Any

from ff_planner_ros.common.declared import (
    DeclaredField,
    DeclaredFields,
    declared,
    fields_of,
    keys_beside,
    level_of,
    must_be_given,
    read_keys,
    written_object,
)
from ff_planner_ros.common.declared_messages import values_in
from ff_planner_ros.common.forms import Form, Schema
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


def schema_of(known: DeclaredFields, prefix: str = "") -> Schema:
    """Return the JSON Schema of a mapping with these keys."""
    properties: Schema = {}
    required, either = [], []
    for head, one in dict(level_of(known, prefix)).items():
        if one is None:
            properties[head] = schema_of(known, f"{prefix}{head}.")
        else:
            among = schema_of(keys_beside(known, prefix + head))["properties"]
            properties[head] = _described(_with_keys(one.form.schema(), among), one)
        if must_be_given(known, prefix + head, one):
            required.append(head)
        if one is not None and one.instead is not None:
            other, form, sentence = one.instead
            properties[other] = form.schema() | {"description": f"instead of {head}: {sentence}."}
            either.append(_one_of(head, other, one))
    schema: Schema = {"type": "object", "properties": properties, "additionalProperties": False}
    if required:
        schema["required"] = required
    return schema | ({"allOf": either} if either else {})


def _with_keys(schema: Schema, more: Schema) -> Schema:
    """Return the schema of a mapping, or of one of several, that may have more keys."""
    if "anyOf" in schema:
        return schema | {"anyOf": [_with_keys(one, more) for one in schema["anyOf"]]}
    return schema | {"properties": schema["properties"] | more} if more else schema


def _described(schema: Schema, one: DeclaredField) -> Schema:
    words = one.sentence + (f", {one.frame}" if one.frame else "")
    words += f" [{one.unit}]" if one.unit else ""
    described = schema | {"description": f"{words}."}
    if one.form.of or one.default is MISSING or (one.default is None and not one.form.spells_none):
        return described
    return described | {"default": one.form.written(one.default)}


def _one_of(head: str, other: str, one: DeclaredField) -> Schema:
    """Return the schema of a mapping with one of two keys; false is as good as left out."""
    given = [
        {"required": [name], "properties": {name: {"not": {"const": False}}}}
        for name in (head, other)
    ]
    choices: list[Schema] = [*given]
    if one.unless is not None:
        key, value, _ = one.unless
        choices.append({"required": [key], "properties": {key: {"const": value}}})
    return {"anyOf": choices, "not": {"allOf": given}}
