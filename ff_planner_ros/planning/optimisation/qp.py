"""The quadratic subproblem of an SQP step.

    minimise    grad f' d + d' H d / 2 + t + penalty s   over the step d, t and the slack s >= 0
    subject to  p + P d <= t,  g + G d + s >= 0,  h + E d = 0,  max |d| <= radius

The core solves it by a dual active-set method, from the working set of the step before.
"""

from __future__ import annotations

from typing import NamedTuple

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE

# Steps aim this far inside, so that whole steps keep a curved constraint, not only tiny ones.
INSIDE = 5.0 * FEASIBILITY_TOLERANCE


class Step(NamedTuple):
    """Solution of a quadratic subproblem."""

    dx: Array  # shape (variables,)
    objective: float  # of the model at the end of the step
    violation: float  # of the linearised constraints there
    constraint_multipliers: Array  # shape (constraints,)
    equality_multipliers: Array  # shape (equalities,)
    max_term_multipliers: Array  # shape (max terms,)
    optimality: float  # first-order optimality at the step's beginning, with its multipliers
    working_set: compiled.WorkingSet
    is_elastic: bool


def solve_qp(
    at_x: object,
    radius: float,
    penalty: float,
    guess: compiled.WorkingSet | None = None,
) -> Step:
    """Return the step that minimises the model of the merit function in the trust region.

    Elastic mode: if the linearised equalities have no solution there, the slack relaxes them to
    either side. Their multipliers are then not reliable. A step of length zero says that rounding
    leaves none.

    Args:
        at_x: A `Linearisation`, or a path that the core evaluated.
        guess: Of a step before, with the same variables. None: there is none.
    """
    return Step(*compiled.solve_subproblem(at_x, radius, penalty, INSIDE, guess))
