"""The paper's optimisation as it is written: what the planner is compared with.

Minimise the objective subject to R_obst = 0, Eq. (43), from xi = 0, by SciPy's SLSQP with finite
differences. The joint limits enter by their smallest margin. R_obst is never negative, so that
R_obst <= 0 says the same; as an equation it stops SLSQP at the first path without collision,
where its gradient vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points, clearances, penalty, segments
from ff_planner_ros.planning.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.objectives import chaser_euler, joint_path_length
from ff_planner_ros.planning.path_family import PathFamily
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.settings import PlannerSettings

# Objective and constraints of a path that meets a singularity: worse than any other's.
_WALL = (1e3, 1e3, -1e3)


@dataclass(frozen=True, eq=False)
class Stop:
    """Where another method stopped."""

    x: Array  # decision variables of the path; shape (variables,)
    rollouts: int
    message: str  # of the method, why


def solve_directly(
    problem: PlanningProblem, settings: PlannerSettings, max_iterations: int
) -> Stop:
    """Solve by SLSQP with finite differences.

    Args:
        settings: For the penalty's g1 and g2.
    """
    family = end_effector_paths(problem)
    functions = _Functions(problem, settings, family)
    result = minimize(
        lambda x: functions(x)[0],
        np.zeros(family.variables),
        method="SLSQP",
        constraints=[
            {"type": "ineq", "fun": lambda x: -functions(x)[1]},
            {"type": "ineq", "fun": lambda x: functions(x)[2]},
        ],
        options={"maxiter": max_iterations, "ftol": 1e-6},
    )
    return Stop(result.x, len(functions.known), result.message)


@dataclass(frozen=True, eq=False)
class _Functions:
    """Objective, penalty and smallest joint margin; one motion serves all three."""

    problem: PlanningProblem
    settings: PlannerSettings
    family: PathFamily
    # Values by the bytes of x.
    known: dict[bytes, tuple[float, float, float]] = field(default_factory=dict)

    def __call__(self, x: Array) -> tuple[float, float, float]:
        key = x.tobytes()
        if key not in self.known:
            self.known[key] = self._evaluate(x)
        return self.known[key]

    def _evaluate(self, x: Array) -> tuple[float, float, float]:
        problem, robot, settings = self.problem, self.problem.robot, self.settings
        motion = self.family.motion(x, problem.points)
        if motion.singular_at is not None:
            return _WALL
        step = problem.duration / (problem.points - 1)
        length = joint_path_length(motion.v[:, 6:], step)
        attitude = float(np.abs(chaser_euler(robot, motion.q)).max())
        positions = arm_points(robot, motion.q)
        distance = clearances(positions, segments(positions), problem.obstacles).distance
        joints = motion.q[:, 7:]
        margins = np.minimum(
            robot.upper_position_limits - joints, joints - robot.lower_position_limits
        )
        weights = problem.objective
        return (
            weights.joint_path_length * length + weights.chaser_attitude * attitude,
            penalty(distance, settings.penalty_gain, settings.penalty_exponent),
            float(margins.min()),
        )
