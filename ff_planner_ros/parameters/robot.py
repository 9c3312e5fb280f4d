"""Parameters of the robot and its limits."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.common.declared import tunable
from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.limits import OF_ONE_NUMBER, Limits
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import SLIDE_WEIGHTS, Base, Robot, read_urdf, robot_from_urdf_text
from ff_planner_ros.robot.urdf.locked_joints import MEASURED, NOTHING_HELD
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice
from ff_planner_ros.robot.wheels import Wheels

# Of robot.geometry: shapes if the arm has any, else lines.
AUTO = "auto"
# Of limits.velocity and limits.effort.
FROM_URDF, NONE = "from_urdf", "none"


@dataclass(frozen=True)
class WheelParameters:
    """Reaction wheels of a robot whose base is attitude_held; their momenta are in the state.

    Raises:
        InvalidInput: The axes are not three numbers each, or a value is refused by `Wheels`.
    """

    axes: tuple[float, ...] = tunable(
        (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        "Axes of the wheels, three numbers each, in axes of the base link",
    )
    momentum: tuple[float, ...] = tunable(
        (0.0,), "Largest momentum of each wheel either way, or one for all; [0.0]: any [N m s]"
    )
    torque: tuple[float, ...] = tunable(
        (0.0,), "Largest torque of each wheel either way, or one for all; [0.0]: any [N m]"
    )

    def __post_init__(self) -> None:
        """Check what no range of a parameter describes."""
        self.wheels()

    def wheels(self) -> Wheels:
        """Return the wheels of the robot, axes in shape (wheels, 3)."""
        if len(self.axes) % 3:
            allowed = "it must have three numbers for each wheel"
            raise InvalidInput(Status.WRONG_SIZE, "robot.wheels.axes", list(self.axes), allowed)
        limits = (given if any(given) else None for given in (self.momentum, self.torque))
        return Wheels(np.reshape(self.axes, (-1, 3)), *limits)


@dataclass(frozen=True)
class RobotParameters:
    """The robot to plan for.

    Raises:
        InvalidInput: `locked_joints` or `xacro_arguments` is malformed.
    """

    wheels: WheelParameters
    urdf: str = tunable(
        "package://ff_planner_ros/config/robots/lemur/lemur.urdf",
        "URDF file: a path or a package:// URI",
    )
    base_link: str = tunable("chaser", "URDF link that carries the arm")
    tip_link: str = tunable("end_effector", "URDF link whose frame is the end effector")
    base: str = tunable(
        "free_flyer",
        "Base: free_flyer; planar (on an air-bearing table); or attitude_held (by robot.wheels)",
        words=Base,
    )
    locked_joints: str = tunable(
        "",
        "Locked joints and their positions [rad or m]: `rail: 0.2, hand: -1.0`; `measured`: all "
        "others that are locked are where they were last measured",
    )

    geometry: str = tunable(
        "auto",
        "Collision geometry: shapes (of the URDF), lines (link centre lines), or auto (shapes if "
        "the arm has any, else lines)",
        words=(AUTO, *Geometry),
    )
    srdf: str = tunable(
        "", "SRDF file of links that may touch; empty: those that touch in nearly every posture"
    )

    slide_weight: float = tunable(
        1.0,
        "Weight of a prismatic joint in the joint path; 0.0: prismatic joints are locked [rad/m]",
        (0.0, SLIDE_WEIGHTS[1]),
    )

    xacro_arguments: str = tunable(
        "",
        "Arguments for URDF and SRDF files that end in .xacro, which the command xacro expands, "
        "as there: `prefix:=left_ gripper:=false`",
    )
    inertia: str = tunable(
        "possible",
        "Inertias that no body has: possible (they are refused), as_given (they count as written, "
        "if their moments are positive), or nearest_possible (the nearest one that a body has)",
        words=InertiaChoice,
    )

    FACTS = ("urdf", "base_link", "tip_link", "base")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check the lists."""
        locked_joints_of(self.locked_joints)
        xacro_arguments_of(self.xacro_arguments)

    def description(self, urdf: Path) -> str:
        """Return the text of the URDF.

        Raises:
            InvalidInput: It cannot be read, or not expanded by xacro.
        """
        return read_urdf(urdf, xacro_arguments=xacro_arguments_of(self.xacro_arguments))

    @property
    def measures(self) -> bool:
        """Whether joints are locked where they were last measured."""
        return MEASURED in map(str.strip, self.locked_joints.split(","))

    def load(
        self,
        description: str,
        directory: Path | None = None,
        measured: Mapping[str, float] = NOTHING_HELD,
    ) -> Robot:
        """Build the robot from the text of a URDF.

        Args:
            directory: Directory of the URDF; None: the text was recorded, and neither meshes nor
                SRDF are read.
            measured: Positions of locked joints [rad, m], beside those of `locked_joints`.

        Raises:
            InvalidInput: URDF or SRDF is refused.
        """
        srdf = None
        if self.srdf and directory is not None:
            field = "robot.srdf"
            file = resolve_uri(self.srdf, relative_to=Path.cwd(), field=field)
            srdf = read_urdf(file, field, xacro_arguments_of(self.xacro_arguments))
        return robot_from_urdf_text(
            description,
            self.base_link,
            self.tip_link,
            Base(self.base),
            {**measured, **locked_joints_of(self.locked_joints)},
            None if self.geometry == AUTO else Geometry(self.geometry),
            srdf,
            directory,
            self.wheels.wheels() if self.base == Base.ATTITUDE_HELD else None,
            self.slide_weight,
            InertiaChoice(self.inertia),
        )


def locked_joints_of(text: str) -> dict[str, float]:
    """Return the positions of locked joints [rad or m] in a text: `rail: 0.2, hand: -1.0`.

    The word `measured` may be among them.

    Raises:
        InvalidInput: The text is malformed.
    """
    field, found = "robot.locked_joints", dict[str, float]()
    for word in filter(None, map(str.strip, text.split(","))):
        if word == MEASURED:
            continue
        name, _, at = (part.strip() for part in word.partition(":"))
        if name in found:
            raise InvalidInput(Status.OUT_OF_RANGE, field, text, "each joint must be there once")
        try:
            found[name] = finite_number(field, float(at))
        except ValueError:
            allowed = "it must be names and numbers: `rail: 0.2, hand: -1.0`"
            raise InvalidInput(Status.OUT_OF_RANGE, field, text, allowed) from None
    return found


def xacro_arguments_of(text: str) -> dict[str, str]:
    """Return arguments of xacro by name, from a text as on its command line.

    Raises:
        InvalidInput: The text is malformed.
    """
    field, allowed = "robot.xacro_arguments", "it must be as in `prefix:=left_ gripper:=false`"
    try:
        words = [word.partition(":=") for word in shlex.split(text)]
    except ValueError as error:
        raise InvalidInput(Status.OUT_OF_RANGE, field, text, f"{allowed}: {error}") from None
    if not all(name.isidentifier() and sign for name, sign, _ in words):
        raise InvalidInput(Status.OUT_OF_RANGE, field, text, allowed)
    return {name: value for name, _, value in words}


@dataclass(frozen=True)
class LimitParameters:
    """Limits that plans keep beside those of the joint positions; a request may ask for less.

    Raises:
        InvalidInput: A limit is not allowed.
    """

    velocity: str = tunable(
        "from_urdf", "Joint velocity limits: from_urdf, or none", words=(FROM_URDF, NONE)
    )
    acceleration: tuple[float, ...] = tunable(
        (0.0,),
        "Largest acceleration of each joint either way, or one for all; [0.0]: any [rad/s2, m/s2]",
    )
    effort: str = tunable(
        "from_urdf",
        "Joint torque limits: from_urdf (its effort limits), or none",
        words=(FROM_URDF, NONE),
    )
    chaser_attitude: float = tunable(
        0.0, "Largest Euler angle of the chaser since the plan's first point; 0.0: any [rad]"
    )
    chaser_rotation: float = tunable(
        0.0, "Largest rotation angle of the chaser since the plan's first point; 0.0: any [rad]"
    )
    grasp_force: float = tunable(0.0, "Largest force through the grasp of a payload; 0.0: any [N]")
    grasp_torque: float = tunable(
        0.0, "Largest torque through the grasp of a payload, about its link's frame; 0.0: any [N m]"
    )
    capture_impulse: float = tunable(
        0.0, "Largest impulse on a captured body, within the grasp's tolerances; 0.0: any [N s]"
    )

    def __post_init__(self) -> None:
        """Check what no range of a parameter describes."""
        self.limits()

    @property
    def accelerations(self) -> tuple[float, ...] | None:
        """Limits of the joint accelerations [rad/s2, m/s2], one a joint or for all; None: any."""
        return self.acceleration if any(self.acceleration) else None

    def limits(self) -> Limits:
        """Return the limits of a problem."""
        return Limits(
            joint_velocities=self.velocity == FROM_URDF,
            joint_accelerations=self.accelerations,
            joint_torques=self.effort == FROM_URDF,
            **{name: getattr(self, name) or math.inf for name in OF_ONE_NUMBER},
        )
