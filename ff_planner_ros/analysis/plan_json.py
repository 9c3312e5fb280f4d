"""A plan, or a refusal, as a dictionary that JSON can hold, and back."""

from __future__ import annotations

import math
from dataclasses import MISSING, asdict, astuple, dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array, finite_number, finite_vector, frozen
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.plan import Plan, RobustReport, SolverReport, Trajectory
from ff_planner_ros.planning.problem import (
    CONTACT_DISTANCE,
    Approach,
    Objective,
    Orientation,
    PlanningProblem,
    Sphere,
    Target,
    attached_spheres,
    lasting,
)
from ff_planner_ros.planning.scenario import approach_of, target_body_of
from ff_planner_ros.planning.scenario_writer import (
    described_approach,
    described_body,
    limits_of,
    weights_of,
)
from ff_planner_ros.planning.scene import Scene
from ff_planner_ros.planning.sound_samples import require_sound_samples
from ff_planner_ros.planning.target_body import TargetBody
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.planning.uncertainty import Uncertainty, uncertainty_from
from ff_planner_ros.robot.bodies import Geometry
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.shown import quoted

_ROBOT = ("urdf", "base_link", "tip_link")
_MOVING = ("linear_velocity", "angular_velocity")
# Of a target body at each point.
_ROWS = ("positions", "quaternions_xyzw", "linear_velocities", "angular_velocities")


@dataclass(frozen=True, eq=False)
class PlanDocument:
    """A plan as its dictionary tells of it."""

    robot: Robot
    plan: Plan
    solve_time: float  # wall clock [s]
    # Of joint path length, chaser attitude and duration; None: the dictionary does not tell
    weights: tuple[float, ...] | None
    # What was planned around; None: the dictionary does not tell
    obstacles: tuple[Sphere, ...] | None
    # Where the end effector was to come; None: the dictionary does not tell
    goal: Target | None
    target_body: TargetBody | None  # that was to be captured; None: none
    approach: Approach | None  # of the last stretch to the goal; None: any way


def plan_dictionary(plan: Plan, task: PlanningTask, solve_time: float) -> dict[str, Any]:
    """Return a plan, its robot and its problem: SI units, radians, a row per point."""
    motion, problem = plan.trajectory, lasting(task.problem, plan.duration)
    return {
        "status": Status.SOLVED.name.lower(),
        "message": plan.message,
        "digest": task.digest,
        "geometry": problem.robot.geometry.value,
        "robot": {
            "urdf": problem.robot.drawn_urdf,
            "base_link": problem.robot.base_link,
            "tip_link": problem.robot.tip_link,
            "base": problem.robot.base.value,
        },
        "target": _target(problem.target),
        "duration": problem.duration,
        "objective": weights_of(problem.objective),
        "obstacles": [
            {"id": sphere.id, "center": sphere.center.tolist(), "radius": sphere.radius}
            | ({"velocity": sphere.velocity.tolist()} if sphere.velocity.any() else {})
            for sphere in problem.obstacles
            if sphere.body is None
        ],
        **_allowed(problem),
        **described_approach(problem.approach),
        **({} if (body := problem.target_body) is None else _body_rows(body, motion.time)),
        "limits": limits_of(problem.limits),
        "joint_names": list(plan.joint_names),
        **{item.name: getattr(motion, item.name).tolist() for item in fields(motion)},
        "parametrisation": plan.family,
        "xi": plan.xi.tolist(),
        "coefficients": plan.coefficients.tolist(),
        "orientation_reading": plan.orientation_reading,
        **({} if plan.robust is None else {"robust": _robust(plan.robust)}),
        **_how_good(plan, solve_time),
    }


def _robust(told: RobustReport) -> dict[str, Any]:
    """Return what a plan keeps back; what has no number is null."""
    pairs = ("clearance", "torques", "deviations")
    numbers = asdict(told) | {name: dict(getattr(told, name)) for name in pairs}
    if not math.isfinite(told.least_sigmas):
        numbers["least_sigmas"] = None
    return numbers


def uncertainty_in(answer: object) -> Uncertainty:
    """Read the errors that a plan's dictionary says it withstands, or else the usual ones.

    Raises:
        InvalidInput: That is something else.
    """
    robust = answer.get("robust", {}) if isinstance(answer, dict) else {}
    told = robust.get("deviations", {}) if isinstance(robust, dict) else robust
    return uncertainty_from("robust.deviations", told)


def _allowed(problem: PlanningProblem) -> dict[str, Any]:
    """Return what may touch at the goal; nothing where nothing may."""
    if not problem.allowed_at_goal:
        return {}
    return {
        "allowed_at_goal": list(problem.allowed_at_goal),
        "contact_distance": problem.contact_distance,
    }


def refusal_dictionary(
    error: FfPlannerError, solve_time: float, digest: str | None = None
) -> dict[str, Any]:
    """Return a refusal: its cause, its task's digest, and how near the best attempt came."""
    refusal: dict[str, Any] = {"status": error.status.name.lower(), "message": str(error)}
    if digest is not None:
        refusal["digest"] = digest
    if isinstance(error, NoPlanFound) and isinstance(error.attempt, Plan):
        refusal |= _how_good(error.attempt, solve_time)
    return refusal


def planned_scene(answer: object) -> Scene | None:
    """Read what a plan's dictionary says that it was made among; None: it does not tell.

    Raises:
        InvalidInput: That is something else.
    """
    body = captured_body(answer)
    obstacles, goal = _asked_for(answer, body)[1], _goal(answer)
    if obstacles is None or goal is None or not isinstance(answer, dict):
        return None
    allowed = answer.get("allowed_at_goal", [])
    if not isinstance(allowed, list) or not all(isinstance(one, str) for one in allowed):
        raise InvalidInput(Status.WRONG_SIZE, "allowed_at_goal", "something else", "a list of text")
    distance = _number("contact_distance", answer.get("contact_distance", CONTACT_DISTANCE))
    return Scene(
        obstacles,
        tuple(allowed),
        distance,
        goal if body is None else None,
        target_body=body,
        capture_time=_number("duration", answer["duration"]) if "duration" in answer else None,
        approach=_approach(answer),
    )


def planned_motion(answer: object) -> tuple[Robot, Trajectory]:
    """Read robot and motion of a plan's dictionary; nothing checks the shapes of the motion.

    Raises:
        InvalidInput: It is no plan, or lacks something.
    """
    status = _entry(answer, "status")
    if status != Status.SOLVED.name.lower():
        found = f"{status} ({_entry(answer, 'message')})"
        raise InvalidInput(Status.UNSUPPORTED, "status", found, "only a plan has a motion")
    described = _entry(answer, "robot")
    urdf, base_link, tip_link = (str(_entry(described, name, "robot.")) for name in _ROBOT)
    base = described.get("base", Base.FREE_FLYER)
    if base not in tuple(Base):
        allowed = f"it must be {', '.join(Base)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "robot.base", quoted(base), allowed)
    kept_clear = None  # what the URDF has: none of earlier versions' answers has a <collision>
    if isinstance(answer, dict) and "geometry" in answer:
        geometry = answer["geometry"]
        if geometry not in tuple(Geometry):
            allowed = f"it must be {', '.join(Geometry)}"
            raise InvalidInput(Status.OUT_OF_RANGE, "geometry", quoted(geometry), allowed)
        kept_clear = Geometry(geometry)
    robot = robot_from_urdf_text(urdf, base_link, tip_link, Base(base), geometry=kept_clear)
    names = _entry(answer, "joint_names")
    if names != list(robot.joint_names):
        allowed = f"they must be those of the robot, {', '.join(robot.joint_names)}"
        raise InvalidInput(Status.UNKNOWN_JOINT, "joint_names", names, allowed)
    samples = {item.name: _entry(answer, item.name) for item in fields(Trajectory)}
    return robot, Trajectory(**{name: _numbers(name, rows) for name, rows in samples.items()})


def plan_document(answer: Any) -> PlanDocument:
    """Read a plan's dictionary; objective, obstacles and target may be missing.

    Raises:
        InvalidInput: It is no plan, lacks something, or its motion is none of its robot.
    """
    robot, trajectory = planned_motion(answer)
    require_sound_samples(robot, trajectory)
    metrics, solver = _entry(answer, "metrics"), _entry(answer, "solver")
    found = {
        item.name: _entry(metrics, item.name, "metrics.")
        for item in fields(Metrics)
        # Dictionaries of older versions lack what has a default.
        if item.default is MISSING or item.name in metrics
    }
    peaks = _numbers("metrics.peak_joint_torques", found.pop("peak_joint_torques"))
    peaks = finite_vector("metrics.peak_joint_torques", peaks, robot.joints)
    values: dict[str, Any] = {
        name: str(value) if name.endswith("_pair") else _number(f"metrics.{name}", value)
        for name, value in found.items()
    }
    told = {item.name: _entry(solver, item.name, "solver.") for item in fields(SolverReport)}
    for name in ("starts", "iterations", "rollouts"):
        told[name] = int(finite_number(f"solver.{name}", told[name]))
    told["optimality"] = _number("solver.optimality", told["optimality"])
    told["stop_reason"] = str(told["stop_reason"])
    plan = Plan(
        joint_names=robot.joint_names,
        trajectory=trajectory,
        xi=_numbers("xi", _entry(answer, "xi")),
        orientation_reading=str(_entry(answer, "orientation_reading")),
        metrics=Metrics(peak_joint_torques=tuple(peaks.tolist()), **values),
        solver=SolverReport(**told),
        duration=_number("duration", answer["duration"]) if "duration" in answer else None,
    )
    solve_time = _number("solver.solve_time", _entry(solver, "solve_time", "solver."))
    body = captured_body(answer)
    weights, obstacles = _asked_for(answer, body)
    goal, approach = _goal(answer), _approach(answer)
    return PlanDocument(robot, plan, solve_time, weights, obstacles, goal, body, approach)


def _approach(answer: Any) -> Approach | None:
    """Return the corridor of a plan's dictionary; None: it has none."""
    return approach_of(answer["approach"]) if "approach" in answer else None


def captured_body(answer: Any) -> TargetBody | None:
    """Return the target body of a plan's dictionary; None: it has none.

    Raises:
        InvalidInput: It is something else.
    """
    told = answer.get("target_body")
    if not isinstance(told, dict):
        return None if told is None else target_body_of(told)
    return target_body_of({name: value for name, value in told.items() if name not in _ROWS})


def _asked_for(
    answer: Any, body: TargetBody | None
) -> tuple[tuple[float, ...] | None, tuple[Sphere, ...] | None]:
    """Return what was minimised and what was avoided; older dictionaries tell neither."""
    objective, obstacles = answer.get("objective"), answer.get("obstacles")
    attached = () if body is None else tuple(attached_spheres(body))
    try:
        return (
            None if objective is None else astuple(Objective(**objective)),
            None if obstacles is None else (*map(_sphere, obstacles), *attached),
        )
    except (TypeError, LookupError):
        allowed = "`ff-planner plan --json` writes them"
        raise InvalidInput(
            Status.WRONG_SIZE, "objective or obstacles", "something else", allowed
        ) from None


def _sphere(sphere: Any) -> Sphere:
    if not isinstance(sphere["id"], str):
        raise InvalidInput(Status.WRONG_SIZE, "obstacles", sphere["id"], "an id must be text")
    return Sphere(**sphere)


def _body_rows(body: TargetBody, times: Array) -> dict[str, Any]:
    """Return a target body as a scenario has it, and where it is at each point."""
    motion = body.motion(np.zeros(3), times)
    quaternions = Rotation.from_matrix(motion.rotations).as_quat()
    rows = (motion.positions, quaternions, motion.twists[:, :3], motion.twists[:, 3:])
    told = {name: values.tolist() for name, values in zip(_ROWS, rows, strict=True)}
    return {"target_body": described_body(body) | told}


def _target(target: Target) -> dict[str, Any]:
    """Return a target as a scenario has it, without accelerations."""
    told = {
        "position": target.position.tolist(),
        "quaternion_xyzw": target.quaternion_xyzw.tolist(),
    }
    for name in _MOVING:
        if (velocity := getattr(target, name)).any():
            told[name] = velocity.tolist()
    if target.orientation is Orientation.FIXED:
        return told
    free_axis = target.free_axis_in_ee
    about = {} if free_axis is None else {"free_axis": free_axis.tolist()}
    return told | {"orientation": target.orientation.value} | about


def _goal(answer: Any) -> Target | None:
    target = answer.get("target")
    if target is None:
        return None
    position, quaternion = (
        _entry(target, name, "target.") for name in ("position", "quaternion_xyzw")
    )
    orientation = target.get("orientation", Orientation.FIXED)
    if orientation not in tuple(Orientation):
        allowed = f"it must be {', '.join(Orientation)}"
        raise InvalidInput(Status.OUT_OF_RANGE, "target.orientation", quoted(orientation), allowed)
    free_axis = target.get("free_axis")
    return Target(
        _numbers("target.position", position),
        _numbers("target.quaternion_xyzw", quaternion),
        **{name: _numbers(f"target.{name}", target[name]) for name in _MOVING if name in target},
        orientation=Orientation(orientation),
        free_axis_in_ee=None
        if free_axis is None
        else finite_vector("target.free_axis", free_axis, 3),
    )


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
