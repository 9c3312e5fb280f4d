"""The robot of a scenario: its files, and how they are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.common.forms import TEXT, Form, a_number, a_word, by_name
from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.common.text_file import NO_ARGUMENTS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.scenario.wheels_file import WheelsFile
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import (
    SLIDE_WEIGHT,
    SLIDE_WEIGHTS,
    Base,
    Robot,
    read_urdf,
    robot_from_urdf_text,
)
from ff_planner_ros.robot.urdf.locked_joints import MEASURED, measurable
from ff_planner_ros.robot.urdf.payload import Payload, with_payload
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice


def _xacro_arguments(field: str, value: object) -> dict[str, str]:
    """Return arguments of xacro as text, by name: `true`, `0.5` or `left_`."""
    if not isinstance(value, Mapping):
        allowed = "it must hold names and values"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(value), allowed)
    for name, given in value.items():
        if not (isinstance(name, str) and isinstance(given, str | int | float)):
            allowed = "it must be text, a number, true or false"
            raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.{name}", quoted(given), allowed)
    return {
        name: str(given).lower() if isinstance(given, bool) else str(given)
        for name, given in value.items()
    }


_XACRO_ARGUMENTS = Form(
    _xacro_arguments,
    lambda: {"type": "object", "additionalProperties": {"type": ["string", "number", "boolean"]}},
    _xacro_arguments,
    dict,
)


def _read_locked(field: str, value: object) -> Mapping[str, float] | str:
    if isinstance(value, str) and value != MEASURED:
        allowed = "it must hold a position for each name of a joint, or be measured"
        raise InvalidInput(Status.OUT_OF_RANGE, field, value, allowed)
    return MEASURED if isinstance(value, str) else POSITIONS.read(field, value)


POSITIONS = by_name("a joint")
_LOCKED = Form(_read_locked, lambda: {"anyOf": [{"const": MEASURED}, POSITIONS.schema()]})
MEASURED_POSITIONS = "joints.locked"


@dataclass(frozen=True)
class RobotFile:
    """The block `robot` of a scenario: the robot's files, and how they are read."""

    urdf: str = declare(
        TEXT,
        "path of the URDF or SDF, relative to this file, or package://PACKAGE/PATH; or the text of "
        "a URDF, which names no files",
    )
    base_link: str = declare(TEXT, "link that carries the arm")
    tip_link: str = declare(TEXT, "link whose frame is the end effector")
    base: Base = declare(
        a_word(Base),
        "motion of the chaser: planar: x, y and rotation about z, on an air-bearing table; "
        "attitude_held: reaction wheels hold its attitude, and it drifts",
        brief=True,
        default=Base.FREE_FLYER,
    )
    wheels: WheelsFile | None = declare(
        part(WheelsFile),
        "reaction wheels of base attitude_held; default: one along each axis of the base link, "
        "without limits",
        default=None,
    )
    locked_joints: Mapping[str, float] | str | None = declare(
        _LOCKED,
        "locked joints and their positions, or measured: as joints.locked has them; default: all "
        "joints that are not between base and tip, at zero",
        unit="rad, m",
        default=None,
    )
    geometry: Geometry | None = declare(
        a_word(Geometry),
        "collision geometry: shapes: the URDF's collision elements; lines: the link centre lines, "
        "as in the paper; default: shapes if the arm has any",
        default=None,
    )
    srdf: str | None = declare(
        TEXT,
        "path of an SRDF, as for the URDF: links that may touch; default: those that touch in "
        "nearly every posture",
        default=None,
    )
    payload: Payload | None = declare(
        part(Payload), "a body that a link holds; default: none", default=None
    )
    slide_weight: float | None = declare(
        a_number(at_least=0.0, at_most=SLIDE_WEIGHTS[1]),
        "weight of a prismatic joint in the joint path, in which a revolute joint counts 1; 0: "
        "prismatic joints are locked; default: 1",
        unit="rad/m",
        default=None,
    )

    xacro_arguments: Mapping[str, str] | None = declare(
        _XACRO_ARGUMENTS,
        "values of the arguments (`<xacro:arg>`) of a urdf or srdf that ends in .xacro, which the "
        "command xacro expands; default: those of the file",
        default=None,
    )
    inertia: InertiaChoice | None = declare(
        a_word(InertiaChoice),
        "inertias that no body has: possible: they are refused; as_given: they count as written, "
        "if their moments are positive; nearest_possible: the nearest one that a body has counts, "
        "with a note; default: possible",
        default=None,
    )

    def load(self, directory: Path | None, measured: Mapping[str, float] | None = None) -> Robot:
        """Load the robot from its files, whose paths may be relative to a directory.

        Args:
            measured: Positions of locked joints [rad, m]; None: there are none.

        Raises:
            InvalidInput: A file cannot be read, or is refused, or a locked joint was not measured.
        """
        asked = self.locked_joints == MEASURED
        if measured is not None and not asked:
            allowed = "it is there with robot.locked_joints measured alone"
            raise InvalidInput(Status.UNSUPPORTED, MEASURED_POSITIONS, "given", allowed)
        given = measured if isinstance(self.locked_joints, str) else self.locked_joints
        text, place, arguments = self.urdf, None, self.xacro_arguments or NO_ARGUMENTS
        if not text.startswith("<"):
            file = resolve_uri(text, relative_to=directory)
            text = read_urdf(file, xacro_arguments=arguments)
            place = file.resolve().parent
        pairs = None
        if self.srdf is not None:
            file = resolve_uri(self.srdf, directory, "robot.srdf")
            pairs = read_urdf(file, "robot.srdf", arguments)
        robot = robot_from_urdf_text(
            text,
            self.base_link,
            self.tip_link,
            self.base,
            given or {},
            self.geometry,
            pairs,
            place,
            None if self.wheels is None else self.wheels.wheels,
            SLIDE_WEIGHT if self.slide_weight is None else self.slide_weight,
            self.inertia or InertiaChoice.POSSIBLE,
        )
        if asked and (missing := measurable(robot.locked_joints, given or {})):
            allowed = "robot.locked_joints is measured: it must have all joints that are locked"
            field = f"{MEASURED_POSITIONS}.{missing[0]}"
            raise InvalidInput(Status.OUT_OF_RANGE, field, "missing", allowed)
        return (
            robot if self.payload is None else with_payload(robot, self.payload.loaded(directory))
        )
