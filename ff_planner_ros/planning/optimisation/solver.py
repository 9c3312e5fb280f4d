"""Minimise f(x) + max_j p_j(x)  subject to  g(x) >= 0, h(x) = 0, by a trust-region SQP method.

The core has the method (optimisation/trust_region.hpp); it asks for the functions at each x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Generic, TypeVar, cast

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE, Evaluation
from ff_planner_ros.planning.optimisation.qp import INSIDE, solve_qp

# Trust region, infinity norm, in units of x. The end effector path's coefficients are metres and
# radians: half a unit is a bold first step.
FIRST_RADIUS = 0.5
# Of violations, in a quadratic program whose multipliers tell the first-order optimality.
_PENALTY = 1e3


class Stop(StrEnum):
    """Why a solver has stopped; all but the last by the core's words."""

    OPTIMALITY = "optimality"
    PROGRESS = "progress"
    CREEPING = "creeping"
    ITERATIONS = "iterations"
    STUCK = "stuck"
    STALLED = "stalled"
    UNDEFINED = "undefined"
    ENOUGH = "enough"  # whoever asked wants no better x

    @property
    def is_good_enough(self) -> bool:
        """Whether x is at an optimum, or near enough to it."""
        return self in (Stop.OPTIMALITY, Stop.PROGRESS, Stop.CREEPING, Stop.ENOUGH)


# In words. The first two may also have converged.
_REASONS = {
    Stop.OPTIMALITY: "first-order optimality is within {tolerance:g}",
    Stop.PROGRESS: "the predicted decrease is at most {progress:g} of the objective",
    Stop.CREEPING: "good enough: eight steps together brought hardly more than one must predict",
    Stop.ITERATIONS: "stopped after {max_iterations} iterations, before convergence",
    Stop.STUCK: "stuck: the violation of the constraints no longer falls",
    Stop.STALLED: "stalled: no step within the smallest trust region brings progress",
    Stop.UNDEFINED: "the functions are not defined at the start",
}

AtX = TypeVar("AtX", bound=Evaluation)


@dataclass(frozen=True, eq=False)
class Solution(Generic[AtX]):
    """Where the solver stopped."""

    x: Array  # shape (variables,)
    at_x: AtX  # functions and derivatives there
    known_optimality: float  # `optimality`; NaN: not computed yet
    # Whether no constraint is violated, and the objective is known to six digits
    converged: bool
    iterations: int  # quadratic programs solved
    stop: Stop
    stop_reason: str  # the same as a sentence
    # SR1 approximation of the Hessian of max terms and constraints, weighted by their multipliers;
    # shape (variables, variables), None if unknown
    curvature: Array | None = None
    radius: float = FIRST_RADIUS  # of the trust region at the end

    @cached_property
    def optimality(self) -> float:
        """Largest entry of the Lagrangian's gradient, or of a constraint times its multiplier."""
        if not self.at_x.is_defined:
            return np.inf
        if np.isfinite(self.known_optimality):
            return self.known_optimality
        return solve_qp(self.at_x, FIRST_RADIUS, _PENALTY).optimality

    @property
    def feasible(self) -> bool:
        """Whether no constraint is violated."""
        return self.at_x.violation <= FEASIBILITY_TOLERANCE


def minimise(
    linearise: Callable[[Array], AtX],
    start: Array,
    max_iterations: int,
    tolerance: float,
    progress: float,
    radius: float = FIRST_RADIUS,
    curvature: Array | None = None,
    tolerated: float = 0.0,
    at_start: AtX | None = None,
) -> Solution[AtX]:
    """Minimise from a start; not converging is a result, not an error.

    Args:
        linearise: Returns functions and derivatives at x; steps to undefined x are rejected.
        tolerance: First-order optimality at which to stop.
        progress: Relative reduction of the objective; the solver stops if a step predicts less.
        radius: Largest entry of the first step: small if the start is nearly optimal.
        curvature: SR1 approximation of another solution. None: zero.
        tolerated: Violation up to which a step is also taken if the objective alone falls as
            predicted, which allows long steps along curved constraints. The solution may violate
            as much. If not zero, a stagnant violation does not end the search.
        at_start: Functions and derivatives at the start. None: they are evaluated.

    Raises:
        ValueError: A value or derivative is not finite, or of a wrong shape.
    """
    x, end, curvature, radius, iterations, word, converged, optimality = compiled.minimise(
        linearise,
        start,
        linearise(start) if at_start is None else at_start,
        np.zeros((len(start), len(start))) if curvature is None else curvature,
        radius,
        max_iterations,
        tolerance,
        progress,
        tolerated,
        FEASIBILITY_TOLERANCE,
        INSIDE,
    )
    stop = Stop(word)
    reason = _REASONS[stop].format(
        tolerance=tolerance, progress=progress, max_iterations=max_iterations
    )
    if stop in (Stop.OPTIMALITY, Stop.PROGRESS):
        reason = f"{'converged' if converged else 'good enough'}: {reason}"
    at_x = cast(AtX, end)
    return Solution(x, at_x, optimality, converged, iterations, stop, reason, curvature, radius)
