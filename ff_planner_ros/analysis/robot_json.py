"""The robot in a plan's dictionary, and the momenta and torques of its reaction wheels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ff_planner_ros.common.arrays import Array, finite_number, finite_vector, frozen
from ff_planner_ros.common.declared import written_object
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Plan, WheelMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.wheels_file import WheelsFile, wheels_file
from ff_planner_ros.robot.model import SLIDE_WEIGHT, Robot
from ff_planner_ros.robot.wheels import Wheels

# Of a motion, in the order of its fields.
_ROWS = ("momenta", "torques")


def robot_told(problem: PlanningProblem) -> dict[str, Any]:
    """Return the robot of a problem as a dictionary, with its wheels as a scenario has them."""
    robot, wheels = problem.robot, wheels_file(problem)
    return {
        "urdf": robot.drawn_urdf,
        "base_link": robot.base_link,
        "tip_link": robot.tip_link,
        "base": robot.base.value,
        **({} if wheels is None else {"wheels": written_object(wheels)}),
        **({"slide_weight": robot.slide_weight} if robot.has_slides else {}),
    }


def wheels_of_robot_read(robot: dict[str, Any]) -> Wheels | None:
    """Read the wheels in a robot's dictionary; None: there are none.

    Raises:
        InvalidInput: They are malformed.
    """
    if "wheels" not in robot:
        return None
    found: WheelsFile = part(WheelsFile).read("robot.wheels", robot["wheels"])
    return found.wheels


def slide_weight_read(robot: dict[str, Any]) -> float:
    """Read the joint path weight of prismatic joints [rad/m]; missing: the default.

    Raises:
        InvalidInput: It is not a positive finite number.
    """
    told = robot.get("slide_weight", SLIDE_WEIGHT)
    return finite_number("robot.slide_weight", told, above=0.0)


def chaser_told(plan: Plan) -> dict[str, Any]:
    """Return the wheels' momenta [N m s] and torques [N m], a row a point, and the rate at rest.

    Both are left out of the dictionary where the plan has none.
    """
    told: dict[str, Any] = {}
    if plan.wheels is not None:
        told["wheels"] = {name: getattr(plan.wheels, name).tolist() for name in _ROWS}
    if plan.turn_rate_at_rest is not None:
        told["turn_rate_at_rest"] = plan.turn_rate_at_rest
    return told


def wheels_read(answer: dict[str, Any]) -> WheelMotion | None:
    """Read the wheels' momenta and torques in a plan's dictionary; None: there are none.

    Raises:
        InvalidInput: They are not a row a point with one number a wheel.
    """
    if "wheels" not in answer:
        return None
    rows = [_numbers(answer["wheels"], "wheels", name) for name in _ROWS]
    points = len(answer.get("time", ()))
    for name, found in zip(_ROWS, rows, strict=True):
        if found.shape != (points, *rows[0].shape[1:]) or found.ndim != 2:
            allowed = "it must have a row a point, and a number a wheel in each"
            raise InvalidInput(Status.WRONG_SIZE, f"wheels.{name}", str(found.shape), allowed)
    return WheelMotion(*rows)


def peaks_read(robot: Robot, metrics: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
    """Read the metrics that have one value for each joint or wheel.

    Raises:
        InvalidInput: They are not one number for each.
    """
    wheels = 0 if robot.wheels is None else robot.wheels.count
    sizes = {"peak_joint_torques": robot.joints}
    sizes |= dict.fromkeys(("peak_wheel_momenta", "peak_wheel_torques"), wheels)
    return {
        name: tuple(finite_vector(f"metrics.{name}", found, count).tolist())
        for name, count in sizes.items()
        if name in metrics
        for found in (_numbers(metrics, "metrics", name),)
    }


def _numbers(block: Any, field: str, name: str) -> Array:
    try:
        return frozen(block[name])
    except (LookupError, TypeError, ValueError, OverflowError):
        allowed = "it must be numbers, as many in each row"
        raise InvalidInput(Status.WRONG_SIZE, f"{field}.{name}", "no array", allowed) from None
