"""The robot in a plan's dictionary, and what its wheels hold and give."""

from __future__ import annotations

from typing import Any

from ff_planner_ros.common.arrays import Array, finite_vector, frozen
from ff_planner_ros.common.declared import written_object
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Plan, WheelMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.wheels_file import WheelsFile, wheels_file
from ff_planner_ros.robot.wheels import Wheels

# Names in the dictionary, of the fields of a motion in their order.
_ROWS, _PEAKS = ("momenta", "torques"), ("peak_wheel_momenta", "peak_wheel_torques")


def robot_told(problem: PlanningProblem) -> dict[str, Any]:
    """Return the robot of a problem; wheels as a scenario has them, where it has some."""
    robot, wheels = problem.robot, wheels_file(problem)
    return {
        "urdf": robot.drawn_urdf,
        "base_link": robot.base_link,
        "tip_link": robot.tip_link,
        "base": robot.base.value,
        **({} if wheels is None else {"wheels": written_object(wheels)}),
    }


def wheels_of_robot_read(robot: dict[str, Any]) -> Wheels | None:
    """Read the wheels of a robot's dictionary; None: it tells none.

    Raises:
        InvalidInput: They are no wheels.
    """
    if "wheels" not in robot:
        return None
    found: WheelsFile = part(WheelsFile).read("robot.wheels", robot["wheels"])
    return found.wheels


def chaser_told(plan: Plan) -> dict[str, Any]:
    """Return what wheels hold and give, a row a point, and how all turns at rest, if it does."""
    told: dict[str, Any] = {}
    if plan.wheels is not None:
        told["wheels"] = {name: getattr(plan.wheels, name).tolist() for name in _ROWS}
    if plan.turn_rate_at_rest is not None:
        told["turn_rate_at_rest"] = plan.turn_rate_at_rest
    return told


def peaks_told(wheels: WheelMotion | None) -> dict[str, tuple[float, ...]]:
    """Return the metrics that tell the largest of each wheel; none: nothing."""
    if wheels is None:
        return {}
    peaks = (wheels.peak_momenta, wheels.peak_torques)
    return {name: tuple(of.tolist()) for name, of in zip(_PEAKS, peaks, strict=True)}


def wheels_read(answer: dict[str, Any]) -> WheelMotion | None:
    """Read what a plan's dictionary says of its wheels; None: nothing.

    Raises:
        InvalidInput: It is none of wheels.
    """
    if "wheels" not in answer:
        return None
    rows = [_numbers(answer["wheels"], "wheels", name) for name in _ROWS]
    peaks = [_numbers(answer.get("metrics"), "metrics", name) for name in _PEAKS]
    points = len(answer.get("time", ()))
    for name, found in zip(_ROWS, rows, strict=True):
        if found.shape != (points, *rows[0].shape[1:]) or found.ndim != 2:
            allowed = "it must have a row a point, and a number a wheel in each"
            raise InvalidInput(Status.WRONG_SIZE, f"wheels.{name}", str(found.shape), allowed)
    for name, found in zip(_PEAKS, peaks, strict=True):
        finite_vector(f"metrics.{name}", found, rows[0].shape[1])
    return WheelMotion(*rows, *peaks)


def _numbers(block: Any, field: str, name: str) -> Array:
    try:
        return frozen(block[name])
    except (LookupError, TypeError, ValueError, OverflowError):
        allowed = "it must be numbers, as many in each row"
        raise InvalidInput(Status.WRONG_SIZE, f"{field}.{name}", "no array", allowed) from None
