"""Values of parameters by their full names: read from files, checked, written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import reduce
from typing import Any, NamedTuple, get_type_hints

from ff_planner_ros.common.declared import (
    DeclaredField,
    DeclaredFields,
    declared_by_name,
    written,
)
from ff_planner_ros.common.plain_values import mapping
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.common.text_file import AnyPath, path_of
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.node import NodeParameters

_LONGEST_NAME = 100  # [characters] of a parameter, more than any has


class _Parameter(NamedTuple):
    name: str  # full
    path: tuple[str, ...]  # of fields from `NodeParameters` to its value
    declared: DeclaredField


GROUPS: dict[str, Any] = {}  # class of each group of parameters, by its full name


def _parameters(group: Any, path: tuple[str, ...] = ()) -> Iterator[_Parameter]:
    types, known = get_type_hints(group), declared_by_name(group)
    for item in fields(group):
        here, kind = (*path, item.name), types[item.name]
        if is_dataclass(kind):
            GROUPS[".".join(here)] = kind
            yield from _parameters(kind, here)
        else:
            one = known[item.name]
            # Files have every parameter, also those that scenarios leave out.
            yield _Parameter(one.key or ".".join(here), here, replace(one, brief=False))


_PARAMETERS = tuple(_parameters(NodeParameters))
# By full name, `planner.starts`.
DECLARATIONS: DeclaredFields = {one.name: one.declared for one in _PARAMETERS}


def default_values() -> dict[str, Any]:
    """Return the default of every parameter by full name, as a parameters file has it."""
    return {name: one.form.written(one.default) for name, one in DECLARATIONS.items()}


def load_parameters(path: AnyPath | None = None) -> NodeParameters:
    """Read a ROS parameters file; parameters that it omits have their defaults.

    Raises:
        InvalidInput: The file cannot be read; a parameter is unknown, of the wrong type or out of
            its range.
    """
    given = {} if path is None else flattened(read_yaml(path_of("path", path)))
    for name in given:
        if name not in DECLARATIONS:
            raise unknown_parameter(name)
    return parameters_of(default_values() | given)


def unknown_parameter(name: str, known: Iterable[str] = DECLARATIONS) -> InvalidInput:
    """Return the error for an unknown parameter name; it lists the most similar names."""
    near = get_close_matches(name[:_LONGEST_NAME], known, n=5, cutoff=0.0)
    allowed = f"known are {', '.join(near)} and others: see docs/reference/parameters.md"
    return InvalidInput(Status.OUT_OF_RANGE, name, "an unknown parameter", allowed)


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
        if isinstance(value, dict) or full in GROUPS:
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
    form = DECLARATIONS[name].form
    return form.checked(name, form.read(name, list(value) if isinstance(value, tuple) else value))


def parameters_of(values: Mapping[str, Any]) -> NodeParameters:
    """Return the parameters with these values, one of every parameter, by full name.

    Raises:
        InvalidInput: A value is not allowed.
    """
    tree: dict[str, Any] = {}
    for name, path, _ in _PARAMETERS:
        block = tree
        for part in path[:-1]:
            block = block.setdefault(part, {})
        block[path[-1]] = checked(name, values[name])
    built: NodeParameters = _built(NodeParameters, tree)
    return built


def _built(group: Any, tree: Mapping[str, Any]) -> Any:
    types = get_type_hints(group)
    return group(
        **{
            name: _built(types[name], value) if isinstance(value, dict) else value
            for name, value in tree.items()
        }
    )


def values_of(parameters: NodeParameters) -> dict[str, Any]:
    """Return the value of every parameter by full name."""
    return {name: reduce(getattr, path, parameters) for name, path, _ in _PARAMETERS}


def document_of(parameters: NodeParameters) -> dict[str, Any]:
    """Return every parameter in the structure of a parameters file: by group, arrays as lists."""
    return written(DECLARATIONS, values_of(parameters))
