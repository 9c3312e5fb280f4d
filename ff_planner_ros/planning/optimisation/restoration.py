"""Feasibility restoration: from where the solver stopped to the nearest x without violations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE, Linearisation
from ff_planner_ros.planning.optimisation.qp import solve_qp
from ff_planner_ros.planning.optimisation.solver import Solution, Stop

AtX = TypeVar("AtX", bound=Linearisation)

# Its first trust region, what is left of one after a step that does not help, and a penalty that
# buys feasibility at any length of step.
_FIRST_RADIUS, _SHRUNK, _PENALTY = 0.2, 0.25, 1e3


def nearest_feasible(
    linearise: Callable[[Array], AtX], start: Array, at_start: AtX, max_iterations: int
) -> Solution[AtX]:
    """Go to the nearest x that keeps every constraint, whatever the objective is there.

    Each step is the shortest that keeps the linearised constraints: near a feasible x the violation
    falls quadratically, while `minimise` would trade it for the objective.

    Args:
        at_start: Functions and derivatives at the start.
    """
    x, at_x, radius, iterations = start, at_start, _FIRST_RADIUS, 0
    working_set = None
    while at_x.violation > FEASIBILITY_TOLERANCE and iterations < max_iterations:
        iterations += 1
        shortest = replace(
            at_x,
            gradient=np.zeros(len(x)),
            hessian=np.eye(len(x)),
            max_terms=at_x.max_terms[:0],
            max_terms_jacobian=at_x.max_terms_jacobian[:0],
        )
        step = solve_qp(shortest, radius, _PENALTY, working_set)
        dx, working_set = step.dx, step.working_set
        at_trial = linearise(x + dx)
        if at_trial.violation < at_x.violation:
            x, at_x = x + dx, at_trial
        else:
            radius = _SHRUNK * float(np.abs(dx).max())
    reason = "good enough: the feasible path nearest to where the solver stopped"
    return Solution(x, at_x, np.nan, False, iterations, Stop.ENOUGH, reason)
