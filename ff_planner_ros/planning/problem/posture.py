"""Goals of the joints instead of the end effector: a given posture, or any posture at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.common.declared import check_declared, declare, written_object
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.common.forms import TRUTH, Schema, a_vector
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.planning.problem.path.circle import CircleToFollow
from ff_planner_ros.planning.problem.path.followed import PathToFollow, end_effector, refuse_grasps
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.robot.configuration import whose_limits
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

if TYPE_CHECKING:
    from ff_planner_ros.planning.problem.problem import PlanningProblem


@dataclass(frozen=True, eq=False)
class Posture:
    """A goal of the joints instead of the end effector: a given posture, or any posture at rest.

    Raises:
        InvalidInput: Not finite, both or neither of positions and at_rest, or velocities without
            as many positions.
    """

    positions: Array | None = declare(  # None: any
        a_vector(None),
        "of each joint at the end",
        key="joints.position",
        unit="rad, m",
        optional=True,
        default=None,
    )
    velocities: Array | None = declare(  # None: zero
        a_vector(None),
        "of each joint at the end; default: zero",
        key="joints.velocity",
        unit="rad/s, m/s",
        optional=True,
        default=None,
    )
    at_rest: bool = declare(
        TRUTH,
        "instead of joints: any posture, in which all joints rest",
        brief=True,
        default=False,
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, "target")
        if (self.positions is not None) == self.at_rest:
            allowed = "it must be true, or joints.position must be given, and not both"
            raise InvalidInput(Status.OUT_OF_RANGE, "target.at_rest", self.at_rest, allowed)
        if self.velocities is None:
            return
        if self.positions is None:
            allowed = "with at_rest it must be left out"
            raise InvalidInput(Status.OUT_OF_RANGE, "target.joints.velocity", "given", allowed)
        finite_vector("target.joints.velocity", self.velocities, len(self.positions))

    @property
    def rates(self) -> Array:
        """Velocities at the end, shape (joints,), or a zero of shape () [rad/s, m/s]."""
        return np.zeros(()) if self.velocities is None else self.velocities

    def require_fits(self, robot: Robot, keeps_rates: bool) -> None:
        """Refuse a posture that is not within the limits of a robot.

        Raises:
            InvalidInput: Another number of joints, a position beyond its limits or, if the problem
                keeps them, a velocity; the error names the joint.
        """
        if self.positions is None:
            return
        finite_vector("target.joints.position", self.positions, robot.joints)
        lower, upper = robot.lower_position_limits, robot.upper_position_limits
        rates = np.broadcast_to(self.rates, lower.shape)
        most = robot.velocity_limits if keeps_rates else np.full(robot.joints, np.inf)
        for name, values, low, high, per_time in (
            ("position", self.positions, lower, upper, ""),
            ("velocity", rates, -most, most, "/s"),
        ):
            for joint in np.flatnonzero((values < low) | (values > high)):
                unit = robot.unit(int(joint)) + per_time
                whose = "" if per_time else whose_limits(robot, int(joint))
                value, least, largest = (float(one[joint]) for one in (values, low, high))
                raise InvalidInput(
                    Status.OUT_OF_RANGE,
                    f"target.joints.{name}[{robot.joint_names[joint]}]",
                    f"{value!r} {unit}",
                    f"the joint's limits are {least!r} to {largest!r} {unit}{whose}",
                )


def _goal(field: str, value: object) -> Goal:
    """Read a target, or the posture, path or circle that some of its keys stand for."""
    keys = value.keys() if isinstance(value, dict) else ()
    named = (kind for key, kind in _KINDS.items() if key in keys)
    found: Goal = part(next(named, Target)).read(field, value)
    return found


def _goal_checked(field: str, value: object) -> Goal:
    if isinstance(value, Posture | PathToFollow | CircleToFollow):
        return value
    return an_object(field, value, Target)


def _goal_schema() -> Schema:
    kinds: tuple[type[Any], ...] = (Target, *_KINDS.values())
    return {"anyOf": [part(kind).schema() for kind in dict.fromkeys(kinds)]}


Goal: TypeAlias = Target | Posture | PathToFollow | CircleToFollow
# What a goal is by its keys; otherwise it is a target.
_KINDS: dict[str, type[Any]] = {
    "joints": Posture,
    "at_rest": Posture,
    "path": PathToFollow,
    "circle": CircleToFollow,
}
GOAL = replace(
    part(Target), read=_goal, schema=_goal_schema, checked=_goal_checked, written=written_object
)


def end_effector_at(robot: Robot, start: SystemState) -> Target:
    """Return the end effector's place in a state as a target of free orientation.

    It is the placeholder target of a problem whose goal is a posture.
    """
    pose, _ = end_effector(robot, start)
    return Target(pose.translation, np.array([0.0, 0.0, 0.0, 1.0]), orientation=Orientation.FREE)


def target_of_posture(problem: PlanningProblem, posture: Posture) -> Target:
    """Check a problem whose goal is a posture, and return its placeholder target.

    Raises:
        InvalidInput: The posture is beyond the robot's limits, or the problem has a target body, an
            approach or a camera: these need a goal with a place.
    """
    posture.require_fits(problem.robot, problem.limits.joint_velocities)
    refuse_grasps(problem, "with a goal of the joints it must be left out: the goal has no place")
    return end_effector_at(problem.robot, problem.start)
