"""The paper's optimisation as printed, with which the planner is compared.

Minimise the objective subject to R_obst = 0, Eq. (43), from xi = 0, by SciPy's SLSQP with finite
differences. The joint limits enter by their smallest margin. R_obst is never negative, so that
R_obst <= 0 says the same; as an equation it stops SLSQP at the first path without collision,
where its gradient vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, penalty, segments
from ff_planner_ros.planning.motion.motion import chaser_euler, joint_path_length
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.paths.path_family import Motion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings

# Objective and constraints of a path that meets a singularity: worse than any other's.
_WALL = (1e3, 1e3, -1e3)


@dataclass(frozen=True, eq=False)
class Stop:
    """The point at which another method stopped."""

    x: Array  # decision variables of the path; shape (variables,)
    rollouts: int  # motions that were integrated
    message: str  # the method's reason


def solve_directly(settings: PlannerSettings, program: PathProgram, max_iterations: int) -> Stop:
    """Solve by SLSQP with finite differences; `settings` has the penalty's g1 and g2, Eq. (47)."""
    # Objective, penalty and smallest joint margin, by the bytes of x: one motion serves all three.
    known: dict[bytes, tuple[float, float, float]] = {}

    def functions(x: Array) -> tuple[float, float, float]:
        key = x.tobytes()
        if key not in known:
            known[key] = _functions(program, settings, x)
        return known[key]

    result = minimize(
        lambda x: functions(x)[0],
        np.zeros(program.family.variables),
        method="SLSQP",
        constraints=[
            {"type": "ineq", "fun": lambda x: -functions(x)[1]},
            {"type": "ineq", "fun": lambda x: functions(x)[2]},
        ],
        options={"maxiter": max_iterations, "ftol": 1e-6},
    )
    return Stop(result.x, len(known), result.message)


def _functions(
    program: PathProgram, settings: PlannerSettings, x: Array
) -> tuple[float, float, float]:
    problem, robot = program.problem, program.problem.robot
    motion = program.family.motion(x, problem.points)
    if motion.singular_at is not None:
        return _WALL
    positions = arm_points(robot, motion.q)
    times = np.linspace(0.0, problem.duration, problem.points)
    distance = clearances(positions, times, segments(positions), problem.obstacles).distance
    joints = motion.q[:, 7:]
    margins = np.minimum(robot.upper_position_limits - joints, joints - robot.lower_position_limits)
    return (
        weighted_objective(problem, motion),
        penalty(distance, settings.penalty_gain, settings.penalty_exponent),
        float(margins.min()),
    )


def weighted_objective(problem: PlanningProblem, motion: Motion) -> float:
    """Return the weighted joint path length and attitude of a motion [rad].

    The objective's terms of duration and wheels are left out.
    """
    step = problem.duration / (problem.points - 1)
    length = joint_path_length(motion.v[:, 6:], step, problem.robot.joint_weights)
    attitude = float(np.abs(chaser_euler(problem.robot, motion.q)).max())
    weights = problem.objective
    return weights.joint_path_length * length + weights.chaser_attitude * attitude
