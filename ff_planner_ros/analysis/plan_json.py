"""A plan, or a refusal, as a dictionary that JSON can hold."""

from __future__ import annotations

import math
from dataclasses import asdict, fields, replace
from operator import attrgetter
from typing import Any

import numpy as np

from ff_planner_ros.analysis.robot_json import (
    chaser_told,
    robot_told,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import (
    DeclaredFields,
    declared,
    written,
    written_object,
)
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan, RobustReport
from ff_planner_ros.planning.problem.problem import (
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.scene import OF_PROBLEM
from ff_planner_ros.planning.problem.user_requirements import requirements_written
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.robot.quaternion import quaternion_from_rotation

# Of the problem, as a scenario has it.
_ASKED = ("target", "target_body", "duration", "objective", "obstacles", "chaser_goal", *OF_PROBLEM)
ASKED: DeclaredFields = {
    key: replace(one, optional=True)  # of a sequence the phases tell it
    for key, one in declared(PlanningProblem).items()
    if one.name.partition(".")[0] in _ASKED
}
ASKED_HEADS = {key.partition(".")[0] for key in ASKED}
# Of a target body at each point.
BODY_ROWS = ("positions", "quaternions_xyzw", "linear_velocities", "angular_velocities")


def plan_dictionary(plan: Plan, task: PlanningTask, solve_time: float) -> dict[str, Any]:
    """Return a plan, its robot and its problem: SI units, radians, a row per point.

    Of a sequence it is the whole motion, and under `phases` each phase as a plan of its own; their
    shares of `solve_time` are those of the rollouts.
    """
    if not plan.then:
        return _phase(plan, task, solve_time)
    told = whole(plan)
    dictionary = {
        "status": Status.SOLVED.name.lower(),
        "message": told.message,
        "digest": task.digest,
        "duration": told.duration,
        **_of_plan(told, solve_time),
    }
    return dictionary | {"phases": _phases(plan, task, solve_time)}


def _phases(plan: Plan, task: PlanningTask, solve_time: float) -> list[dict[str, Any]]:
    """Return each phase of a sequence as a plan of its own."""
    rollouts = max(whole(plan).solver.rollouts, 1)
    return [
        _phase(found, one, solve_time * found.solver.rollouts / rollouts)
        for one, found in phase_tasks(task, plan)
    ]


def _phase(plan: Plan, task: PlanningTask, solve_time: float) -> dict[str, Any]:
    """Return a plan by itself."""
    motion, problem = plan.trajectory, lasting(task.problem, plan.duration)
    return {
        "status": Status.SOLVED.name.lower(),
        "message": plan.message,
        "digest": task.digest,
        "geometry": problem.robot.geometry.value,
        "robot": robot_told(problem),
        **_asked(problem, motion.time),
        "limits": written_object(problem.limits),
        **_requirements(problem),
        **_of_plan(plan, solve_time),
        "coefficients": plan.coefficients.tolist(),
        **({} if plan.robust is None else {"robust": _robust(plan.robust)}),
    }


def _requirements(problem: PlanningProblem) -> dict[str, Any]:
    """Return the requirements that the user brought; none: nothing."""
    given = problem.requirements
    return {"requirements": requirements_written(given)} if given else {}


def received_dictionary(
    plan: Plan, plan_id: str, digest: str, start: float, solve_time: float
) -> dict[str, Any]:
    """Return a plan received from a node: as `plan_dictionary`, without robot and problem.

    Args:
        start: ROS time of the plan's first point [s].
    """
    return {
        "status": Status.SOLVED.name.lower(),
        "message": plan.message,
        "plan_id": plan_id,
        "digest": digest,
        "start": start,
        **_of_plan(plan, solve_time),
    }


def _of_plan(plan: Plan, solve_time: float) -> dict[str, Any]:
    """Return the motion of a plan, its path, metrics and solver report."""
    motion = plan.trajectory
    return {
        "joint_names": list(plan.joint_names),
        **{item.name: getattr(motion, item.name).tolist() for item in fields(motion)},
        "parametrisation": plan.family,
        "effort": plan.effort,
        "xi": plan.xi.tolist(),
        "orientation_reading": plan.orientation_reading,
        **chaser_told(plan),
        **_how_good(plan, solve_time),
    }


def _robust(told: RobustReport) -> dict[str, Any]:
    """Return the margins of a robust plan; an infinite `least_sigmas` is null."""
    pairs = ("clearance", "torques", "deviations")
    numbers = asdict(told) | {name: dict(getattr(told, name)) for name in pairs}
    if not math.isfinite(told.least_sigmas):
        numbers["least_sigmas"] = None
    return numbers


def refusal_dictionary(
    error: FfPlannerError,
    solve_time: float,
    digest: str | None = None,
    task: PlanningTask | None = None,
) -> dict[str, Any]:
    """Return a refusal: its cause, its task's digest, and the metrics of the best attempt.

    Args:
        task: If given, `phases` holds the plans of a sequence before the phase without a plan.
    """
    refusal: dict[str, Any] = {"status": error.status.name.lower(), "message": str(error)}
    if digest is not None:
        refusal["digest"] = digest
    if not isinstance(error, NoPlanFound):
        return refusal
    if error.effort:
        refusal["effort"] = error.effort
    if isinstance(error.attempt, Plan):
        refusal |= _how_good(error.attempt, solve_time)
    if task is not None and isinstance(error.found, Plan):
        refusal["phases"] = _phases(error.found, task, solve_time)
    return refusal


def _asked(problem: PlanningProblem, times: Array) -> dict[str, Any]:
    """Return a problem as a scenario has it, with its target body's motion at some times."""
    values = {key: attrgetter(one.name)(problem) for key, one in ASKED.items()}
    values["target"] = problem.posture or problem.path or problem.target
    values["obstacles"] = [one for one in problem.obstacles if one.body is None]
    asked = written(ASKED, values)
    if problem.target_body is not None:
        motion = problem.target_body.motion(np.zeros(3), times)
        quaternions = quaternion_from_rotation(motion.rotations)
        rows = (motion.positions, quaternions, motion.twists[:, :3], motion.twists[:, 3:])
        asked["target_body"] |= {
            name: values.tolist() for name, values in zip(BODY_ROWS, rows, strict=True)
        }
    return asked


def _how_good(plan: Plan, solve_time: float) -> dict[str, Any]:
    solver = {"solve_time": solve_time, **asdict(plan.solver)}
    metrics = {name: of for name, of in asdict(plan.metrics).items() if of != ()}
    return {
        "metrics": {name: _finite(value) for name, value in metrics.items()},
        "solver": {name: _finite(value) for name, value in solver.items()},
    }


def _finite(value: Any) -> Any:
    """Return None for infinity, which JSON does not know: of a clearance without obstacles, say."""
    if isinstance(value, tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
