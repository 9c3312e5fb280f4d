"""A plan, or a refusal, read back from its dictionary."""

from __future__ import annotations

import math
from dataclasses import MISSING, astuple, dataclass, fields
from typing import Any

from ff_planner_ros.analysis.plan_json import ASKED, ASKED_HEADS, BODY_ROWS
from ff_planner_ros.analysis.robot_json import (
    peaks_read,
    slide_weight_read,
    wheels_of_robot_read,
    wheels_read,
)
from ff_planner_ros.common.arrays import Array, finite_number, frozen
from ff_planner_ros.common.declared import (
    fields_of,
    read_keys,
)
from ff_planner_ros.common.forms import a_word
from ff_planner_ros.errors import Faults, InvalidInput, Status
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.problem import (
    PathToFollow,
    PlanningProblem,
    Target,
    attached,
)
from ff_planner_ros.planning.problem.scene import OF_PROBLEM, Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty, uncertainty_from
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.meshes import Meshes

_ROBOT = ("urdf", "base_link", "tip_link")


@dataclass(frozen=True, eq=False)
class PlanDocument:
    """A plan, its robot and its scene, read from a dictionary."""

    robot: Robot
    plan: Plan
    solve_time: float  # wall clock [s]
    # Of the objective, in the order of the fields of `Objective`; None: not in the dictionary
    weights: tuple[float, ...] | None
    # At the plan's first point; None: not in the dictionary
    obstacles: tuple[Obstacle, ...] | None
    scene: Scene  # as far as it is in the dictionary


def planned_scene(answer: object) -> Scene | None:
    """Read the scene in a plan's dictionary; None if target or obstacles are missing.

    Raises:
        InvalidInput: A value of the problem is malformed.
    """
    asked = _asked_in(answer)
    if not {"target", "obstacles"} <= asked.keys():
        return None
    return _scene(asked)


def _scene(asked: dict[str, Any]) -> Scene:
    """Return the scene of the problem that `_asked_in` has read."""
    body, told = asked.get("target_body"), fields_of(PlanningProblem, asked)
    target = asked.get("target")
    return Scene(
        **{name: told[name] for name in ("obstacles", *OF_PROBLEM) if name in told},
        target=target if body is None and isinstance(target, Target) else None,
        target_body=body,
        capture_time=asked.get("duration"),
        path=target if isinstance(target, PathToFollow) else None,
    )


def planned_motion(answer: object) -> tuple[Robot, Trajectory]:
    """Read robot and motion in a plan's dictionary; the shapes of the motion are not checked.

    Raises:
        InvalidInput: The dictionary is a refusal, or an entry is missing or malformed.
    """
    status = _entry(answer, "status")
    if status != Status.SOLVED.name.lower():
        found = f"{status} ({_entry(answer, 'message')})"
        raise InvalidInput(Status.UNSUPPORTED, "status", found, "only a plan has a motion")
    described = _entry(answer, "robot")
    urdf, base_link, tip_link = (str(_entry(described, name, "robot.")) for name in _ROBOT)
    base = a_word(Base).read("robot.base", described.get("base", Base.FREE_FLYER))
    kept_clear = None  # as the URDF says
    if isinstance(answer, dict) and "geometry" in answer:
        kept_clear = a_word(Geometry).read("geometry", answer["geometry"])
    wheels, weight = wheels_of_robot_read(described), slide_weight_read(described)
    told = urdf, base_link, tip_link, base
    robot = robot_from_urdf_text(*told, geometry=kept_clear, wheels=wheels, slide_weight=weight)
    names = _entry(answer, "joint_names")
    if names != list(robot.joint_names):
        allowed = f"they must be those of the robot, {', '.join(robot.joint_names)}"
        raise InvalidInput(Status.UNKNOWN_JOINT, "joint_names", names, allowed)
    samples = {item.name: _entry(answer, item.name) for item in fields(Trajectory)}
    return robot, Trajectory(**{name: _numbers(name, rows) for name, rows in samples.items()})


def phases_of(answer: Any, name: str) -> list[tuple[str, Any]]:
    """Return name and dictionary of each phase of an answer; without phases, of the answer."""
    phases = answer.get("phases") if isinstance(answer, dict) else None
    if not isinstance(phases, list) or not phases:
        return [(name, answer)]
    return [(f"{name}, phase {number}", one) for number, one in enumerate(phases, start=1)]


def plan_document(answer: Any) -> PlanDocument:
    """Read a plan's dictionary; objective, obstacles and target may be missing.

    Raises:
        InvalidInput: The dictionary is a refusal, an entry is missing or malformed, or the motion
            does not belong to the robot.
    """
    robot, trajectory = planned_motion(answer)
    require_sound_samples(robot, trajectory)
    metrics, solver = _entry(answer, "metrics"), _entry(answer, "solver")
    found = {
        item.name: _entry(metrics, item.name, "metrics.")
        for item in fields(Metrics)
        if item.default is MISSING or item.name in metrics  # an empty one is not written
    }
    peaks = peaks_read(robot, found)
    values: dict[str, Any] = peaks | {
        name: str(value) if name.endswith("_pair") else _number(f"metrics.{name}", value)
        for name, value in found.items()
        if name not in peaks
    }
    told = {item.name: _entry(solver, item.name, "solver.") for item in fields(SolverReport)}
    for name in ("starts", "iterations", "rollouts"):
        told[name] = int(finite_number(f"solver.{name}", told[name]))
    told["optimality"] = _number("solver.optimality", told["optimality"])
    told["stop_reason"] = str(told["stop_reason"])
    asked = _asked_in(answer)
    plan = Plan(
        joint_names=robot.joint_names,
        trajectory=trajectory,
        xi=_numbers("xi", _entry(answer, "xi")),
        orientation_reading=str(_entry(answer, "orientation_reading")),
        metrics=Metrics(**values),
        solver=SolverReport(**told),
        duration=asked.get("duration"),
        effort=int(finite_number("effort", answer.get("effort", 0))),
        wheels=wheels_read(answer),
    )
    solve_time = _number("solver.solve_time", _entry(solver, "solve_time", "solver."))
    return PlanDocument(
        robot,
        plan,
        solve_time,
        weights=astuple(asked["objective"]) if "objective" in asked else None,
        obstacles=asked.get("obstacles"),
        scene=_scene(asked),
    )


def uncertainty_in(answer: object) -> Uncertainty:
    """Read the deviations in a robust plan's dictionary; those it lacks have their defaults.

    Raises:
        InvalidInput: They are no mapping of names and numbers.
    """
    robust = answer.get("robust", {}) if isinstance(answer, dict) else {}
    told = robust.get("deviations", {}) if isinstance(robust, dict) else robust
    return uncertainty_from("robust.deviations", told)


def _asked_in(answer: Any) -> dict[str, Any]:
    """Return the fields of the problem in a plan's dictionary, by key.

    Raises:
        InvalidInput: A value is malformed.
    """
    given = answer if isinstance(answer, dict) else {}
    told = {key: given[key] for key in given if key in ASKED_HEADS and given[key] is not None}
    if isinstance(body := told.get("target_body"), dict):
        told["target_body"] = {name: body[name] for name in body if name not in BODY_ROWS}
    faults = Faults()
    asked = read_keys(ASKED, "", told, faults)
    faults.refuse()
    if "obstacles" in asked:
        # It carries the hulls of its meshes, and names no files.
        asked["obstacles"] = tuple(
            one.with_mesh_read(f"obstacles[{index}]", Meshes(None))
            for index, one in enumerate(asked["obstacles"])
        )
    if {"obstacles", "target_body"} <= asked.keys():
        asked["obstacles"] += tuple(attached(asked["target_body"]))
    return asked


def _number(name: str, value: Any) -> float:
    """Return a number; null stands for infinity, which JSON does not know."""
    number = _numbers(name, math.inf if value is None else value)
    if number.ndim or math.isnan(number):
        raise InvalidInput(Status.WRONG_SIZE, name, value, "it must be one number, or null")
    return float(number)


def _entry(dictionary: object, name: str, prefix: str = "") -> Any:
    if not isinstance(dictionary, dict) or name not in dictionary:
        allowed = "`ff-planner plan --json` writes it"
        raise InvalidInput(Status.WRONG_SIZE, f"{prefix}{name}", "missing", allowed)
    return dictionary[name]


def _numbers(name: str, rows: Any) -> Array:
    try:
        return frozen(rows)
    except (TypeError, ValueError, OverflowError):
        allowed = "it must be numbers, as many in each row"
        raise InvalidInput(Status.WRONG_SIZE, name, "no array", allowed) from None
