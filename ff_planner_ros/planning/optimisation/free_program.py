"""The optimisation problem with the duration as one more variable.

All functions depend on the path's variables x and on the duration T: through the goal, the
obstacles, the drift by the momentum and the limits of velocities. Derivatives by x and by T are
exact; those by T are at fixed normalised time s = t / T:

- The path at s depends on T through its ends: the k-th derivative by s is T^k times that by time,
  and the goal's pose, twist and acceleration change by the goal's own motion.
- Base and joints are differentiated through the same integration steps as by x, whose length is
  proportional to T. The system's centre of mass drifts for longer, and velocities are 1 / T times
  derivatives by s.
- Each requirement adds what depends on T beside the motion: spheres and grasp move to their places
  at s T, and expressions in velocities and time steps change with the step.

Neglected is only that the grid and the names of the rows may change with T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.paths.path_family import GoalMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting

# Names of the rows that keep the duration within its range; those of requirements are not negative.
_BOUNDS = np.array([-1, -2])


@dataclass(frozen=True, eq=False)
class FreeProgram:
    """Objectives and requirements of a problem as functions of (x, T / unit)."""

    problem: PlanningProblem  # with a range of durations
    program: PathProgram  # for one duration in the range
    weight: float  # of the duration, added to the objective of the program [rad/s]
    unit: float  # of the last variable [s]

    def duration(self, along: Array) -> float:
        """Return the duration of variables (x, T / unit), clipped to its range [s]."""
        window = self.problem.durations
        return float(np.clip(along[-1] * self.unit, window.minimum, window.maximum))

    def at(self, duration: float) -> PathProgram:
        """Return the program at a duration [s]; its last variable is the duration."""
        problem = lasting(self.problem, duration)
        family = self.program.family.lasting(problem, goal_motion(self.problem, duration))
        return replace(self.program, problem=problem, family=family)

    def linearise(self, along: Array) -> PathLinearisation:
        """Return objective and constraints of a path and a duration with their derivatives."""
        here = self.at(self.duration(along)).linearise(along[:-1])
        return self._in_range(here, float(along[-1]) * self.unit) if here.is_defined else here

    def _in_range(self, here: PathLinearisation, duration: float) -> PathLinearisation:
        """Return a linearisation with the duration's weight and the bounds of its range added.

        Args:
            here: With derivatives by the duration, per second, in the last column.
            duration: From the variables, not clipped to the range [s].
        """
        variables = len(here.gradient)
        units = np.ones(variables)
        units[-1] = self.unit
        # The duration is added to the max terms of the attitude, or is one: only then the solver
        # approximates the constraints' curvature, which alone decides the shortest duration.
        max_terms, by_x = here.max_terms, here.max_terms_jacobian * units
        if not max_terms.size:
            max_terms, by_x = np.zeros(1), np.zeros((1, variables))
        by_x[:, -1] += self.weight * self.unit
        window = self.problem.durations
        bounds = np.array([duration - window.minimum, window.maximum - duration])
        by_bounds = np.zeros((2, variables))
        by_bounds[:, -1] = self.unit, -self.unit
        return replace(
            here,
            gradient=here.gradient * units,
            hessian=here.hessian * np.outer(units, units),
            max_terms=max_terms + self.weight * duration,
            max_terms_jacobian=by_x,
            constraints=np.concatenate([here.constraints, bounds]),
            constraints_jacobian=np.concatenate([here.constraints_jacobian * units, by_bounds]),
            equalities_jacobian=here.equalities_jacobian * units,
            names=np.concatenate([here.names, _BOUNDS]),
        )


def goal_motion(problem: PlanningProblem, duration: float) -> GoalMotion:
    """Return the derivatives of a problem's goal by the duration, at a duration [s]."""
    body, nothing = problem.target_body, np.zeros(6)
    if body is None:
        place = np.append(problem.durations.target_velocity, nothing[3:])
        return GoalMotion(place, nothing, nothing)
    grasp = body.grasp(np.array([duration]))
    return GoalMotion(grasp.twists[0], grasp.accelerations[0], grasp.jerks[0])
