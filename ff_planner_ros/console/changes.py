"""Changes of a task by hand: goal, path, obstacle, weights or duration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import (
    ChaserGoal,
    DurationRange,
    Orientation,
    PathToFollow,
    PlanningProblem,
    with_capture_target,
)
from ff_planner_ros.planning.task.task import PlanningTask

GOAL = "goal"


def movable(problem: PlanningProblem) -> tuple[str, ...]:
    """Return what can be moved: `GOAL`, if it is a pose, and the ids of free obstacles."""
    given = problem.target_body, problem.posture, problem.path
    fixed = any(one is not None for one in given)
    free = [one.id for one in problem.obstacles if one.body is None]
    return (*(() if fixed else (GOAL,)), *(one for one in free if one != GOAL))


def place_of(problem: PlanningProblem, name: str) -> tuple[Array, Array | None]:
    """Return position [m] and quaternion, x y z w, of a movable thing; None: it has no axes."""
    if name == GOAL:
        target = problem.target
        turned = None if target.orientation is Orientation.FREE else target.quaternion_xyzw
        return target.position, turned
    one = next(one for one in problem.obstacles if one.id == name)
    return one.motion.position, None if one.is_sphere else one.motion.quaternion_xyzw


def moved(
    task: PlanningTask, name: str, position: Array, quaternion_xyzw: Array | None = None
) -> PlanningTask:
    """Return a task with the goal or an obstacle at another pose, at the same time as before.

    Args:
        name: One of `movable`.
        position: In the inertial frame. Shape (3,) [m].
        quaternion_xyzw: None: the orientation stays.

    Raises:
        InvalidInput: Nothing of this name can be moved, or the pose is invalid.
    """
    problem = task.problem
    if name not in movable(problem):
        allowed = f"it must be one of {', '.join(movable(problem)) or 'nothing'}"
        raise InvalidInput(Status.UNSUPPORTED, "moved", name, allowed)
    turned: dict[str, Any] = {}
    if quaternion_xyzw is not None:
        turned = {"quaternion_xyzw": quaternion_xyzw}
    if name == GOAL:
        target = replace(problem.target, position=position, **turned)
        return _with(task, replace(problem, target=target))
    obstacles = tuple(
        one.with_motion(position=position, **turned) if one.id == name else one
        for one in problem.obstacles
    )
    return _with(task, replace(problem, obstacles=obstacles))


def weighted(task: PlanningTask, joint_path: float, attitude: float) -> PlanningTask:
    """Return a task with other weights of joint path and chaser attitude; other weights stay.

    Raises:
        InvalidInput: All weights are zero.
    """
    problem = task.problem
    weights = replace(problem.objective, joint_path_length=joint_path, chaser_attitude=attitude)
    return _with(task, replace(problem, objective=weights))


def attaining(task: PlanningTask, goal: ChaserGoal) -> PlanningTask:
    """Return a task whose chaser has another attitude at the goal."""
    return _with(task, replace(task.problem, chaser_goal=goal))


def along(task: PlanningTask, path: PathToFollow | None) -> PlanningTask:
    """Return a task whose end effector follows a path; None: it goes to where that ended.

    Raises:
        InvalidInput: The task has a target body, an approach or a camera.
    """
    duration, window = task.problem.duration, task.problem.duration_range
    if path is not None:
        duration, window = path.duration, None
    changed = replace(task.problem, path=path, duration=duration, duration_range=window)
    return _with(task, changed)


def lasting_for(task: PlanningTask, shortest: float, longest: float) -> PlanningTask:
    """Return a task with another duration, or another range if the task has a range [s].

    The grasp of a target body is where the body is after the longest duration.

    Raises:
        InvalidInput: A duration is not positive, or a target body rotates too far.
    """
    problem, window = task.problem, task.problem.duration_range
    if window is not None:
        window = DurationRange(shortest, longest, window.target_velocity)
    problem = replace(problem, duration=longest, duration_range=window)
    if problem.target_body is not None:
        problem = with_capture_target(problem.target_body, problem)
    return _with(task, problem)


def _with(task: PlanningTask, problem: PlanningProblem) -> PlanningTask:
    # The step at which a search was ended, and its first guess, belong to what it was.
    return replace(task, problem=problem, effort=0, first_guess=None)


def rounded(position: Array) -> Array:
    """Return a position rounded to a tenth of a millimetre. Shape (3,) [m]."""
    return np.asarray(np.round(position, 4), np.float64)
