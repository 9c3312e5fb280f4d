"""The path families that are searched for a problem, by its trajectory parameterisation."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.motion import straight_way
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.paths.end_effector_polynomial import (
    PAPERS_JOINTS,
    applies,
    end_effector_families,
)
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import Orientation, Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.chaser_at_goal import ChaserAtGoal
from ff_planner_ros.planning.requirements.limits.chaser_rotation import (
    ChaserAttitude,
    ChaserRotation,
)
from ff_planner_ros.planning.requirements.singular_values import is_regular
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base

# A limit is active for a plan that is no further from it than so many times the margin.
_AT_LIMIT = 2.0
# A joint path longer than so many times the straight line between its ends is a detour.
_DETOUR = 1.25


@lru_cache(maxsize=2)
def path_families(
    problem: PlanningProblem, settings: PlannerSettings
) -> tuple[Sequence[PathFamily], ...]:
    """Return path families in the order of trial, each as its ways round to the goal.

    There are two ways for half a turn of the end effector. Cached, as the library of plans needs
    the families before the planner does.

    Raises:
        InvalidInput: As by `require_families`.
    """
    require_families(problem)
    asked = problem.parametrisation
    if asked is Parametrisation.END_EFFECTOR_POLYNOMIAL:
        return (end_effector_families(problem),)
    splines = [joint_splines(problem, settings)]
    if asked is Parametrisation.JOINT_SPLINE or not applies(problem):
        return (splines,)
    q_start, _ = configuration(problem.robot, problem.start)
    if not is_regular(problem.robot, q_start, settings):
        return (splines,)
    return end_effector_families(problem), splines


def ways_of_guess(
    problem: PlanningProblem, settings: PlannerSettings, guess: ArrayLike
) -> tuple[Sequence[PathFamily], Array]:
    """Return the families that a guess may be of, and its numbers.

    Raises:
        InvalidInput: It is not finite, or no family has so many variables.
    """
    groups = path_families(problem, settings)
    size = len(guess) if isinstance(guess, Sized) else 0
    ways = next((ways for ways in groups if ways[0].variables == size), groups[0])
    return ways, finite_vector("first_guess", guess, ways[0].variables)


def require_families(problem: PlanningProblem) -> None:
    """Refuse the paper's family where it is requested, but not defined for arm, base or goal.

    Raises:
        InvalidInput: It is.
    """
    asked = problem.parametrisation
    if asked is Parametrisation.END_EFFECTOR_POLYNOMIAL:
        advice = "it must be auto or joint_spline"
        require_papers_paths(problem, "parametrisation", asked.value, advice)


def require_papers_paths(problem: PlanningProblem, field: str, value: str, advice: str) -> None:
    """Refuse a problem that the paper's paths are not defined for.

    Args:
        field: Field whose value requests them.
        advice: Words on what to choose instead.

    Raises:
        InvalidInput: They are not defined for the arm, its base or the goal.
    """
    robot = problem.robot
    reasons = {
        "a goal of the joints": problem.posture is not None,
        "a path to follow": problem.path is not None,
        f"an arm of {robot.joints} joints": robot.joints < PAPERS_JOINTS,
        "a planar base": robot.base is Base.PLANAR,
        "a base whose attitude wheels hold": robot.base is Base.ATTITUDE_HELD,
        "a target that leaves the orientation free": (
            problem.target.orientation is not Orientation.FIXED
        ),
    }
    for reason, holds in reasons.items():
        if holds:
            raise InvalidInput(Status.UNSUPPORTED, field, value, f"with {reason} {advice}")


def is_held(problem: PlanningProblem, settings: PlannerSettings, plan: Plan) -> bool:
    """Tell whether a limit on the chaser's rotation is active for a plan."""
    limits, metrics, goal = problem.limits, plan.metrics, problem.chaser_goal
    motion = plan.trajectory
    at_goal = int(np.abs(motion.time - problem.duration).argmin())
    off = goal.off(*motion.chaser_quaternions_xyzw[[0, at_goal]])
    return any(
        limit - reached <= _AT_LIMIT * required.margin(problem, settings)
        for required, limit, reached in (
            (ChaserAttitude(), limits.chaser_attitude, metrics.max_chaser_euler),
            (ChaserRotation(), limits.chaser_rotation, metrics.max_chaser_rotation),
            (ChaserAtGoal(), goal.most, off),
        )
        if limit < np.inf
    )


def is_detour(joints: Array, weights: Array | float = 1.0) -> bool:
    """Tell whether a joint path is a detour.

    Args:
        joints: Joint positions on the way. Shape (points, joints) [rad, m].
        weights: Weight of each joint. Shape (joints,).
    """
    length = np.linalg.norm(weights * np.diff(joints, axis=0), axis=1).sum()
    return bool(length > _DETOUR * straight_way(joints[[0, -1]], weights))
