"""Reaction wheels in the messages of a state and of a plan, from ROS or decoded from a bag."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages.trajectories import table
from ff_planner_ros.planning.motion.plan import WheelMotion

if TYPE_CHECKING:  # to read a bag's table loads no Pinocchio
    from ff_planner_ros.robot.model import Robot


def wheel_momenta_in(state: Any, field: str, robot: Robot) -> Array | None:
    """Return the wheels' momenta in a state message. Shape (wheels,) [N m s]; None without any.

    Raises:
        InvalidInput: The robot has no wheels or another number, or a momentum is not finite.
    """
    found = state.wheel_momenta
    if not len(found):
        return None
    if robot.wheels is None:
        allowed = "it must be empty: there are no wheels"
        raise InvalidInput(Status.WRONG_SIZE, field, list(found), allowed)
    return finite_vector(field, found, robot.wheels.count)


def wheels_in(plan: Any) -> WheelMotion | None:
    """Return the wheels' momenta and torques in a plan message; None without any.

    Raises:
        ValueError: Its number of wheel points or of wheels is not the same throughout.
    """
    told = plan.wheels
    if not len(told):
        return None
    points, count = len(plan.joint_trajectory.points), len(told[0].momenta)
    momenta = table("wheel momenta", [one.momenta for one in told], points, count)
    torques = table("wheel torques", [one.torques for one in told], points, count)
    return WheelMotion(momenta, torques)


def wheels_of(plans: Sequence[Any]) -> WheelMotion | None:
    """Return the wheels' motion over the plans of all phases; None if a phase lacks it."""
    first, *others = map(wheels_in, plans)
    for after in others:
        first = None if first is None or after is None else first.followed_by(after)
    return first
