"""A plan that waits to be published, and checks that it still fits rules and state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.published_plans import PublicationParameters
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.configuration import without_turns
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.outputs.preview import Drawn
from ff_planner_ros.ros.parameters import stricter_since
from ff_planner_ros.ros.requests.continuing import motion_on
from ff_planner_ros.ros.requests.reading import Knowledge

# Parameters that no plan is checked by when it is made.
_NOT_OF_PLANS = ("publication.", "tracking.")


@dataclass(frozen=True, eq=False)
class MadePlan:
    """A plan that passed every check, with what is needed to publish it."""

    plan_id: str
    plan: Plan
    start_ns: int  # time of its first point [ns]
    end_behaviour: str
    robot: Robot  # with its payload
    scene: Scene  # at the plan's first point
    parameters: NodeParameters  # that the plan was checked by
    previous_plan_id: str = ""  # plan that the joints follow until the start; empty: none
    made_ns: int = 0  # when the plan was ready [ns]

    @cached_property
    def drawn(self) -> Drawn:
        """The plan, as visualisation needs it."""
        frame = self.parameters.inertial_frame
        return Drawn(self.plan_id, self.robot, self.plan, self.scene, frame)

    def may_go_out(self, now_ns: int, most: float) -> bool:
        """Return whether the start is not over and the age is at most `most` seconds."""
        return self.start_ns >= now_ns and self.age(now_ns) <= most

    def age(self, now_ns: int) -> float:
        """Return how long ago the plan was ready [s]."""
        return (now_ns - self.made_ns) / NANOSECONDS


class Difference(NamedTuple):
    """How far one number of a system is from a plan's first point."""

    what: str
    parameter: str  # parameter below `publication.` that limits it
    found: float
    allowed: float
    unit: str

    @property
    def is_allowed(self) -> bool:
        """Whether it is within its limit; NaN is not."""
        return self.found <= self.allowed


def require_same_rules(made: MadePlan, parameters: NodeParameters) -> None:
    """Refuse a plan if a rule that it was checked by has become stricter.

    Raises:
        NoPlanFound: A rule has (CHECK_FAILED).
    """
    stricter = [
        name
        for name in stricter_since(made.parameters, parameters)
        if not name.startswith(_NOT_OF_PLANS)
    ]
    if stricter:
        raise NoPlanFound(
            Status.CHECK_FAILED,
            f"{made.plan_id} was checked before these parameters became stricter: "
            f"{', '.join(stricter)}; ask for a new plan",
        )


def require_young(made: MadePlan, knowledge: Knowledge) -> None:
    """Refuse a plan whose age exceeds `publication.max_age`.

    Raises:
        NoPlanFound: It does (CHECK_FAILED).
    """
    age = made.age(knowledge.now_ns)
    most = knowledge.parameters.publication.max_age
    if age > most:
        raise NoPlanFound(
            Status.CHECK_FAILED,
            f"{made.plan_id} was made {age:.3g} s ago, longer than publication.max_age, {most:g} "
            "s; ask for a new plan",
        )


def require_same_start(made: MadePlan, differences: Iterable[Difference]) -> None:
    """Refuse a plan if the system will be too far from its first point.

    Args:
        differences: From `start_differences`.

    Raises:
        NoPlanFound: A difference is larger than allowed (STATE_MOVED).
    """
    off = [
        f"{one.what} by {one.found:.3g} {one.unit}, more than publication.{one.parameter}, "
        f"{one.allowed:g} {one.unit}"
        for one in differences
        if not one.is_allowed
    ]
    if off:
        raise NoPlanFound(
            Status.STATE_MOVED,
            f"the system will not be where {made.plan_id} begins: it will miss {'; '.join(off)}; "
            "ask for a new plan",
        )


def start_differences(
    made: MadePlan, measured: Snapshot, knowledge: Knowledge
) -> Iterator[Difference]:
    """Yield how far the system, predicted to a plan's start time, is from its first point."""
    followed = knowledge.followed(measured, made.start_ns)
    continuous = knowledge.robot.continuous
    running = motion_on(followed, measured, continuous) if followed else None
    # A state may be stamped ahead of now by state_future_tolerance, and so be later than the start
    # of a plan that begins at once.
    ahead = max(made.start_ns - measured.stamp_ns, 0) / NANOSECONDS
    there = carried_forward(made.robot, measured.state, ahead, running)
    yield from (
        Difference(*one)
        for one in _differences(
            there, made.plan.trajectory, knowledge.robot, knowledge.parameters.publication
        )
    )


def _differences(
    state: SystemState, motion: Trajectory, robot: Robot, allowed: PublicationParameters
) -> Iterator[tuple[str, str, float, float, str]]:
    """Yield how far a state is from a plan's first point, as `Difference` has it."""

    def distance(a: Array, b: Array) -> float:
        return float(np.linalg.norm(a - b))

    attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
    planned = Rotation.from_quat(motion.chaser_quaternions_xyzw[0])
    position = distance(state.position_chaser_in_inertial, motion.chaser_positions[0])
    velocity = distance(
        state.linear_velocity_chaser_in_inertial, motion.chaser_linear_velocities[0]
    )
    turning = distance(
        state.angular_velocity_chaser_in_inertial, motion.chaser_angular_velocities[0]
    )
    angle = float((planned.inv() * attitude).magnitude())
    yield "the chaser's position", "max_position", position, allowed.max_position, "m"
    yield "its attitude", "max_angle", angle, allowed.max_angle, "rad"
    yield "its velocity", "max_velocity", velocity, allowed.max_velocity, "m/s"
    most = allowed.max_angular_velocity
    yield "its angular velocity", "max_angular_velocity", turning, most, "rad/s"
    aside = without_turns(state.joint_positions - motion.joint_positions[0], robot.continuous)
    rates = state.joint_velocities - motion.joint_velocities[0]
    for what, parameter, off, unit in (
        ("position", "max_joint_position", aside, "rad"),
        ("rate", "max_joint_velocity", rates, "rad/s"),
    ):
        most = getattr(allowed, parameter)
        for name, found in zip(robot.joint_names, np.abs(robot.joint_weights * off), strict=True):
            yield f"{name}'s {what}", parameter, float(found), most, unit
