"""Values of parameters by their full names: read from files, checked, replaced."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from enum import StrEnum
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from ff_planner_ros.common.declared import DeclaredField, DeclaredFields, declared_by_name
from ff_planner_ros.common.plain_values import mapping
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.common.text_file import AnyPath, path_of
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.node import NodeParameters

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Group = TypeVar("Group", bound="DataclassInstance")

_LONGEST_NAME = 100  # [characters] of a parameter, more than any has
# Types of JSON Schema as parameters files have them.
_KINDS: Mapping[str, str] = {
    "boolean": "true or false",
    "string": "text",
    "integer": "a whole number",
    "number": "a number with a decimal point",
    "array": "an array of numbers with a decimal point",
}
# Full names of fields of NodeParameters that differ from the field's name.
_FULL_NAMES = {"library": "planner.library", "plug_ins": "planner.plugins"}
_FIELDS = {full: name for name, full in _FULL_NAMES.items()}


def _full_name(prefix: str, name: str) -> str:
    return f"{prefix}{name}" if prefix else _FULL_NAMES.get(name, name)


def _declarations(group: Any, prefix: str = "") -> DeclaredFields:
    types, known = get_type_hints(group), declared_by_name(group)
    found: dict[str, DeclaredField] = {}
    for item in fields(group):
        name = _full_name(prefix, item.name)
        if is_dataclass(types[item.name]):
            found |= _declarations(types[item.name], f"{name}.")
        else:
            found[name] = known[item.name]
    return found


# By full name, `planner.starts`.
DECLARATIONS: DeclaredFields = _declarations(NodeParameters)
_GROUPS = {name.rpartition(".")[0] for name in DECLARATIONS}


def load_parameters(path: AnyPath | None = None) -> NodeParameters:
    """Read a ROS parameters file; parameters that it omits are those of `config/planner.yaml`.

    Raises:
        InvalidInput: The file cannot be read; a parameter is unknown, of the wrong type or out of
            its range.
    """
    values = dict(default_values())
    given = {} if path is None else flattened(read_yaml(path_of("path", path)))
    for name, value in given.items():
        if name not in DECLARATIONS:
            raise unknown_parameter(name)
        values[name] = checked(name, value)
    return parameters_of(values)


def unknown_parameter(name: str) -> InvalidInput:
    """Return the error for an unknown parameter name; it lists the most similar names."""
    near = get_close_matches(name[:_LONGEST_NAME], DECLARATIONS, n=5, cutoff=0.0)
    known = f"known are {', '.join(near)} and others: see config/planner.yaml"
    return InvalidInput(Status.OUT_OF_RANGE, name, "an unknown parameter", known)


@cache
def default_values() -> Mapping[str, Any]:
    """Return the values of `config/planner.yaml` by full name."""
    return flattened(read_yaml(share_directory() / "config" / "planner.yaml"))


def flattened(document: Any) -> dict[str, Any]:
    """Return the values in a document of ROS parameters by full name, not checked.

    Raises:
        InvalidInput: The document has not the structure that ROS expects.
    """
    nodes = mapping("", document, required=(), optional=("/**", "ff_planner", "/ff_planner"))
    values: dict[str, Any] = {}
    for node, block in nodes.items():
        of_node = dict[str, Any]()
        told = mapping(node, block, required=("ros__parameters",))["ros__parameters"]
        _flatten(told, "", of_node)
        values |= of_node
    return values


def _flatten(block: Any, prefix: str, values: dict[str, Any]) -> None:
    if not isinstance(block, dict):
        field = prefix.rstrip(".") or "ros__parameters"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(block), "it must hold parameters")
    for name, value in block.items():
        full = f"{prefix}{name}"
        if isinstance(value, dict) or full in _GROUPS:
            _flatten(value, f"{full}.", values)
        elif full in values:  # as `robot.urdf` and below `robot`
            raise InvalidInput(Status.OUT_OF_RANGE, full, "given twice", "give it once")
        else:
            values[full] = value


def checked(name: str, value: Any) -> Any:
    """Return a value as its parameter is declared; an array becomes a tuple.

    Raises:
        InvalidInput: It is of the wrong type or out of its range.
    """
    form, given = DECLARATIONS[name].form, list(value) if isinstance(value, tuple) else value
    try:
        return form.checked(name, form.read(name, given))
    except InvalidInput:
        raise InvalidInput(Status.OUT_OF_RANGE, name, quoted(value), allowed_values(name)) from None


def allowed_values(name: str) -> str:
    """Return what a parameter may be, in words."""
    declared = DECLARATIONS[name]
    schema = declared.form.schema()
    words = f"one of {', '.join(schema['enum'])}" if "enum" in schema else _KINDS[schema["type"]]
    for word, bound in (("least", "minimum"), ("most", "maximum")):
        words += f", at {word} {schema[bound]:g}" if bound in schema else ""
    unit = f"[{declared.unit}] " if declared.unit else ""
    return f"it must be {words} {unit}({declared.sentence})"


def parameters_of(values: Mapping[str, Any]) -> NodeParameters:
    """Return the parameters with these values, one of every parameter, by full name.

    Raises:
        InvalidInput: A value is not allowed.
    """
    return _group(NodeParameters, values, "")


def _group(group: type[Group], values: Mapping[str, Any], prefix: str) -> Group:
    types, read = get_type_hints(group), dict[str, Any]()
    for item in fields(group):
        kind, name = types[item.name], _full_name(prefix, item.name)
        if is_dataclass(kind):
            read[item.name] = _group(kind, values, f"{name}.")  # type: ignore[arg-type]
        else:
            value = values[name]
            read[item.name] = tuple(value) if isinstance(value, list) else value
    return group(**read)


def replaced(group: Group, name: str, value: Any) -> Group:
    """Return parameters with one value replaced; an unknown name changes nothing.

    Raises:
        InvalidInput: A value is not allowed.
    """
    first, _, rest = _FIELDS.get(name, name).partition(".")
    if first not in {item.name for item in fields(group)}:
        return group
    inner = replaced(getattr(group, first), rest, value) if rest else value
    return replace(group, **{first: inner})


def value_of(parameters: NodeParameters, name: str) -> Any:
    """Return the value of a parameter by its full name; None: there is no such parameter."""
    value: Any = parameters
    for part in _FIELDS.get(name, name).split("."):
        value = getattr(value, part, None)
    return value


def document_of(parameters: NodeParameters) -> dict[str, Any]:
    """Return every parameter in the structure of a parameters file: by group, arrays as lists."""
    document: dict[str, Any] = {}
    for name in DECLARATIONS:
        *groups, last = name.split(".")
        block = document
        for group in groups:
            block = block.setdefault(group, {})
        value = value_of(parameters, name)
        plain = str(value) if isinstance(value, StrEnum) else value
        block[last] = list(plain) if isinstance(plain, tuple) else plain
    return document
