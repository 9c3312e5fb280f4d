"""The optimisation problem with the duration as one more variable.

Everything that moves with the duration T, the goal, the obstacles, the momentum's drift and the
limits on rates, is a function of the path's variables x and of T. Both kinds of derivatives are
exact. Those by T are at fixed parts s of it, so that a point stays what it is and comes later:

- The path at s depends on T through its ends: the k-th derivative by s is T^k times that by time,
  and the goal's pose, twist and acceleration change as they do on the goal's own way.
- Base and joints follow through the same steps of the integration as by x, each step being a part
  of T; the system's centre of mass drifts for longer; rates by time are 1 / T of those by s.
- Each requirement adds what depends on T beside the motion: spheres and grasp are elsewhere at s T,
  and what is made of rates and steps of time changes with the step.

That the plan's grid and the names of its rows stay the same is all that is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.paths.path_family import GoalMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting

# Names of the rows that keep the duration within its range; those of requirements are not negative.
_BOUNDS = np.array([-1, -2])


@dataclass(frozen=True, eq=False)
class FreeProgram:
    """Objectives and requirements of a problem as functions of (x, T / unit)."""

    problem: PlanningProblem  # with a range of durations
    program: PathProgram  # of one of them
    weight: float  # of the duration, beside the objective of the program [rad/s]
    unit: float  # of the last variable [s]

    def duration(self, along: Array) -> float:
        """Return the duration that variables stand for, within its range [s]."""
        window = self.problem.durations
        return float(np.clip(along[-1] * self.unit, window.minimum, window.maximum))

    def at(self, duration: float) -> PathProgram:
        """Return the program of one duration [s], whose last variable is the duration."""
        problem = lasting(self.problem, duration)
        family = self.program.family.lasting(problem, goal_motion(self.problem, duration))
        return replace(self.program, problem=problem, family=family)

    def linearise(self, along: Array) -> PathLinearisation:
        """Return objective and constraints of a path and a duration with their derivatives."""
        here = self.at(self.duration(along)).linearise(along[:-1])
        return self._in_range(here, float(along[-1]) * self.unit) if here.is_defined else here

    def _in_range(self, here: PathLinearisation, duration: float) -> PathLinearisation:
        """Return functions of a path with the duration's weight and its range.

        Args:
            here: Derivatives by the duration are per second, last.
            duration: As the variables say it, in its range or not [s].
        """
        variables = len(here.gradient)
        units = np.ones(variables)
        units[-1] = self.unit
        # The duration is a max term, beside those of the attitude: the solver then learns how
        # the constraints are curved, which alone decide where the shortest duration is.
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
    """Return how the goal of a problem changes with its duration [s]."""
    body, nothing = problem.target_body, np.zeros(6)
    if body is None:
        place = np.append(problem.durations.target_velocity, nothing[3:])
        return GoalMotion(place, nothing, nothing)
    grasp = body.grasp(np.array([duration]))
    return GoalMotion(grasp.twists[0], grasp.accelerations[0], grasp.jerks[0])
