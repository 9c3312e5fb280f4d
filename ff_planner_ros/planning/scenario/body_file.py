"""A target body from a URDF, in a file beside its scenario or in a message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ff_planner_ros.common.declared import (
    DeclaredField,
    DeclaredFields,
    declared,
    fields_of,
    read_keys,
)
from ff_planner_ros.common.declared_parts import part, schema_of
from ff_planner_ros.common.forms import INERTIA, TEXT, Form, Schema, a_word, by_name
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.errors import Faults
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.robot.collision.urdf_body import LOCKED_JOINTS, urdf_body
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import read_urdf
from ff_planner_ros.robot.urdf.locked_joints import NOTHING_HELD
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice

_KEY = "urdf"
_WITHOUT = part(TargetBody)
_CHOICE = a_word(InertiaChoice)


def _inertia(field: str, value: object) -> object:
    return (_CHOICE if isinstance(value, str) else INERTIA).read(field, value)


def _checked_inertia(field: str, value: object) -> object:
    return (_CHOICE if isinstance(value, str) else INERTIA).checked(field, value)


_INERTIA = replace(
    INERTIA,
    read=_inertia,
    schema=lambda: {"anyOf": [INERTIA.schema(), _CHOICE.schema()]},
    checked=_checked_inertia,
)
_OF_URDF: DeclaredFields = {
    **declared(TargetBody),
    "inertia": replace(
        declared(TargetBody)["inertia"],
        form=_INERTIA,
        sentence=f"{declared(TargetBody)['inertia'].sentence}; or, of a urdf, as robot.inertia: "
        f"{', '.join(InertiaChoice)}",
        optional=True,
    ),
    _KEY: DeclaredField(
        TEXT,
        "path of a URDF or SDF of the body, relative to this file, or package://: its shapes move "
        "with it, its axes are those of the root link, and it says an inertia that is left out; "
        "default: none",
        optional=True,
    ),
    LOCKED_JOINTS: DeclaredField(
        by_name("a joint"),
        "positions of the joints of the urdf, all of which are locked; default: zero, or the limit "
        "nearest to zero",
        unit="rad, m",
        optional=True,
    ),
}


def with_urdf(
    given: Mapping[str, Any],
    text: str,
    told: str,
    directory: Path | None = None,
    locked_joints: Mapping[str, float] = NOTHING_HELD,
    inertia: InertiaChoice = InertiaChoice.POSSIBLE,
) -> dict[str, Any]:
    """Return the fields of a target body, completed by its URDF.

    The URDF's solids, named by their links, are beside the given obstacles. Its inertia is used
    unless one is given.

    Args:
        given: Fields of the body that are known otherwise.
        text: The URDF. The body's axes are those of its root link.
        told: Name of the URDF in errors.
        directory: Directory that its meshes are relative to; None: no file may be read.
        locked_joints: Positions of its joints [rad, m].
        inertia: What happens to inertias of its links that no body has.

    Raises:
        InvalidInput: The text is no URDF of a body.
    """
    body = urdf_body(text, told, directory, locked_joints, inertia)
    fixed = [
        AttachedObstacle(
            one.name,
            one.solid,
            one.place.translation,
            eigen_quaternion(one.place.rotation),
        )
        for one in body.solids
    ]
    beside = given.get("obstacles", ())
    told_of = {"inertia": body.inertia, "notes": body.notes}
    return {**told_of, **given, "obstacles": (*fixed, *beside)}


@dataclass(frozen=True, eq=False)
class BodyFile:
    """A target body whose URDF is in a file."""

    given: Mapping[str, Any]  # fields of the body
    urdf: str
    locked_joints: Mapping[str, float]  # positions [rad, m]
    inertia: InertiaChoice

    def load(self, directory: Path | None) -> TargetBody:
        """Read the URDF, whose path may be relative to a directory, and return the body.

        Raises:
            InvalidInput: The file cannot be read, or describes no body.
        """
        told = f"target_body.{_KEY}"
        path = resolve_uri(self.urdf, directory, told)
        text = read_urdf(path, told)
        at = path.resolve().parent, self.locked_joints, self.inertia
        return TargetBody(**with_urdf(self.given, text, told, *at))


def _read(field: str, value: object) -> TargetBody | BodyFile:
    faults = Faults()
    read = read_keys(_OF_URDF, field, value, faults)
    if isinstance(value, dict) and not {"inertia", _KEY} & value.keys():
        faults.add(f"{field}.inertia", "missing", f"give it or a {_KEY}")
    if LOCKED_JOINTS in read and _KEY not in read:
        faults.add(f"{field}.{LOCKED_JOINTS}", "given", f"without a {_KEY} there are no joints")
    faults.refuse()
    choice = InertiaChoice.POSSIBLE
    if isinstance(read.get("inertia"), InertiaChoice):
        choice = read.pop("inertia")
        if _KEY not in read:
            faults.add(f"{field}.inertia", choice, f"without a {_KEY} it must be numbers")
            faults.refuse()
    given, held = fields_of(TargetBody, read), read.get(LOCKED_JOINTS, NOTHING_HELD)
    return BodyFile(given, read[_KEY], held, choice) if _KEY in read else TargetBody(**given)


def _schema() -> Schema:
    return schema_of(_OF_URDF) | {"anyOf": [{"required": [key]} for key in ("inertia", _KEY)]}


def _checked(field: str, value: object) -> TargetBody | BodyFile:
    return value if isinstance(value, BodyFile) else an_object(field, value, TargetBody)


TARGET_BODY: Form = replace(_WITHOUT, read=_read, schema=_schema, checked=_checked)
