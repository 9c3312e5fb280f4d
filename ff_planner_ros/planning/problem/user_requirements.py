"""Requirements of plug-ins, in files and by the names of their entry points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any

from ff_planner_ros.common.declared import check_declared, written_object
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.common.forms import Form
from ff_planner_ros.common.plain_values import sequence
from ff_planner_ros.common.plug_ins import plug_in
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.errors import Faults, InvalidInput, Status

if TYPE_CHECKING:
    from ff_planner_ros.planning.requirements.requirement import Requirement

PLUG_INS = "ff_planner_ros.requirements"  # group of entry points


def requirements_read(field: str, value: object) -> tuple[Requirement, ...]:
    """Return requirements of plug-ins from a mapping of names to their values.

    Raises:
        InvalidInput: It is no such mapping, no plug-in has a name, or a value is refused.
    """
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
        allowed = "it must hold the values of each requirement, by name"
        raise InvalidInput(Status.OUT_OF_RANGE, field, value, allowed)
    found, faults = [], Faults()
    for name, given in value.items():
        with faults.gathered():
            kind = plug_in(PLUG_INS, name, f"{field}.{name}")
            found.append(part(kind).read(f"{field}.{name}", given))
    faults.refuse()
    return tuple(found)


def requirements_written(given: Sequence[Requirement]) -> dict[str, Any]:
    """Return requirements of plug-ins as a mapping for files."""
    return {one.name: written_object(one) for one in given}


def _requirements_checked(field: str, value: object) -> tuple[Requirement, ...]:
    given = sequence(field, value)
    names = [getattr(one, "name", quoted(one)) for one in given]
    for one, name in zip(given, names, strict=True):
        if not is_dataclass(one) or names.count(name) > 1:
            allowed = "each must be a dataclass with declared fields, and have a name of its own"
            raise InvalidInput(Status.UNSUPPORTED, field, names, allowed)
        check_declared(one, f"{field}.{name}")
    return tuple(given)


REQUIRED = Form(
    requirements_read,
    lambda: {"type": "object", "additionalProperties": {"type": "object"}},
    _requirements_checked,
    requirements_written,
)
