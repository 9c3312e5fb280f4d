"""An answer of the planner as a dictionary that JSON can hold, and back."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from typing import Any

from ff_planner_ros.arrays import Array, frozen
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan, Trajectory
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

_ROBOT = ("urdf", "base_link", "tip_link")


def plan_dictionary(plan: Plan, robot: Robot, solve_time: float) -> dict[str, Any]:
    """Return a plan and the robot it is for: SI units, radians, a row per point.

    Args:
        plan: The plan.
        robot: The robot.
        solve_time: Wall clock of the answer [s].
    """
    motion = plan.trajectory
    return {
        "status": Status.SOLVED.name.lower(),
        "message": plan.solver.stop_reason,
        "robot": {name: getattr(robot, name) for name in _ROBOT},
        "joint_names": list(plan.joint_names),
        **{item.name: getattr(motion, item.name).tolist() for item in fields(motion)},
        "xi": plan.xi.tolist(),
        "orientation_reading": plan.orientation_reading,
        **_how_good(plan, solve_time),
    }


def refusal_dictionary(error: FfPlannerError, solve_time: float) -> dict[str, Any]:
    """Return a refusal: its cause, and how near the best attempt came; never a trajectory.

    Args:
        error: Why there is no plan.
        solve_time: Wall clock of the answer [s].
    """
    refusal = {"status": error.status.name.lower(), "message": str(error)}
    if isinstance(error, NoPlanFound) and isinstance(error.attempt, Plan):
        refusal |= _how_good(error.attempt, solve_time)
    return refusal


def planned_motion(answer: object) -> tuple[Robot, Trajectory]:
    """Read robot and motion back out of a plan's dictionary.

    Args:
        answer: Of `plan_dictionary`, as JSON gives it back.

    Returns:
        The robot, and arrays of whatever shape they have in the dictionary.

    Raises:
        InvalidInput: It is no plan, or lacks something.
    """
    status = _entry(answer, "status")
    if status != Status.SOLVED.name.lower():
        found = f"{status} ({_entry(answer, 'message')})"
        raise InvalidInput(Status.UNSUPPORTED, "status", found, "only a plan has a motion")
    described = _entry(answer, "robot")
    urdf, base_link, tip_link = (str(_entry(described, name, "robot.")) for name in _ROBOT)
    robot = robot_from_urdf_text(urdf, base_link, tip_link)
    names = _entry(answer, "joint_names")
    if names != list(robot.joint_names):
        allowed = f"they must be those of the robot, {', '.join(robot.joint_names)}"
        raise InvalidInput(Status.UNKNOWN_JOINT, "joint_names", names, allowed)
    samples = {item.name: _entry(answer, item.name) for item in fields(Trajectory)}
    return robot, Trajectory(**{name: _numbers(name, rows) for name, rows in samples.items()})


def _entry(dictionary: object, name: str, prefix: str = "") -> Any:
    if not isinstance(dictionary, dict) or name not in dictionary:
        allowed = "`ff-planner plan --json` writes it"
        raise InvalidInput(Status.WRONG_SIZE, f"{prefix}{name}", "missing", allowed)
    return dictionary[name]


def _numbers(name: str, rows: Any) -> Array:
    try:
        return frozen(rows)
    except (TypeError, ValueError):
        allowed = "it must be numbers, as many in each row"
        raise InvalidInput(Status.WRONG_SIZE, name, "no array", allowed) from None


def _how_good(plan: Plan, solve_time: float) -> dict[str, Any]:
    solver = {"solve_time": solve_time, **asdict(plan.solver)}
    return {
        "metrics": {name: _finite(value) for name, value in asdict(plan.metrics).items()},
        "solver": {name: _finite(value) for name, value in solver.items()},
    }


def _finite(value: Any) -> Any:
    """JSON knows no infinity: without obstacles, say, there is no clearance to tell."""
    if isinstance(value, tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
