"""The optimisation problem with the duration as one more variable.

Everything that moves with the duration, the goal, the obstacles, the momentum's drift and the
limits on rates, is a function of the path's variables x and of the duration T. The program of
one duration knows the exact derivatives by x. Those by T are central differences of objective and
rows as a whole, good to nine digits: whatever a requirement depends on, nothing is forgotten.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.problem import PlanningProblem, lasting
from ff_planner_ros.planning.program import PathLinearisation, PathProgram

# Of the duration: a difference between durations so far apart is exact to nine digits.
_STEP = 1e-4
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
        """Return the program of one duration [s]."""
        problem = lasting(self.problem, duration)
        family = self.program.family.lasting(problem)
        return replace(self.program, problem=problem, family=family)

    def linearise(self, along: Array) -> PathLinearisation:
        """Return objective and constraints of a path and a duration with their derivatives."""
        x, duration = along[:-1], self.duration(along)
        here = self.at(duration).linearise(x)
        step = _STEP * duration
        sides = [self.at(duration + side * step).linearise(x) for side in (-1.0, 1.0)]
        if not (here.is_defined and all(side.is_defined for side in sides)):
            return replace(here, is_defined=False)
        return self._with_duration(here, sides, step, float(along[-1]) * self.unit)

    def _with_duration(
        self,
        here: PathLinearisation,
        sides: Sequence[PathLinearisation],
        step: float,
        duration: float,
    ) -> PathLinearisation:
        """Return functions of a path with their derivatives by the duration, too.

        Args:
            sides: The same path at durations that are a step [s] shorter and longer.
            duration: As the variables say it, in its range or not [s].
        """
        before, after = sides
        over = self.unit / (2.0 * step)
        slope = (after.value - before.value) * over
        bent = (after.value - 2.0 * here.value + before.value) * (self.unit / step) ** 2
        turned = (after.gradient - before.gradient) * over
        constraints_by_t = _difference(here, before, after) * (2.0 * over)
        # The duration is told as a peak, beside those of the attitude: the solver then learns how
        # the constraints are curved, which alone decide where the shortest duration is.
        peaks, by_x, by_duration = (
            here.peaks,
            here.peaks_jacobian,
            (after.peaks - before.peaks) * over,
        )
        if not peaks.size:
            peaks, by_x, by_duration = np.zeros(1), np.zeros((1, len(here.gradient))), np.zeros(1)
        by_duration = by_duration + self.weight * self.unit
        window = self.problem.durations
        bounds = np.array([duration - window.minimum, window.maximum - duration])
        by_bounds = np.zeros((2, len(here.gradient) + 1))
        by_bounds[:, -1] = self.unit, -self.unit
        return replace(
            here,
            gradient=np.append(here.gradient, slope),
            hessian=_convex(np.block([[here.hessian, turned[:, None]], [turned, bent]])),
            peaks=peaks + self.weight * duration,
            peaks_jacobian=_widened(by_x, by_duration),
            constraints=np.concatenate([here.constraints, bounds]),
            constraints_jacobian=np.concatenate(
                [_widened(here.constraints_jacobian, constraints_by_t), by_bounds]
            ),
            equalities_jacobian=_widened(
                here.equalities_jacobian, (after.equalities - before.equalities) * over
            ),
            names=np.concatenate([here.names, _BOUNDS]),
        )


def _difference(
    here: PathLinearisation, before: PathLinearisation, after: PathLinearisation
) -> Array:
    """Return by how much each constraint grows with one step, from the sides that know it.

    A constraint that is of interest here and on no side is at the edge of what is of interest.
    """
    total, known = np.zeros(len(here.names)), np.zeros(len(here.names))
    for side, sign in ((before, -1.0), (after, 1.0)):
        _, mine, its = np.intersect1d(here.names, side.names, return_indices=True)
        total[mine] += sign * (side.constraints[its] - here.constraints[mine])
        known[mine] += 1.0
    return total / np.maximum(known, 1.0)


def _widened(jacobian: Array, column: Array) -> Array:
    return np.column_stack([jacobian, column])


def _convex(hessian: Array) -> Array:
    values, vectors = np.linalg.eigh(hessian)
    convex: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return convex
