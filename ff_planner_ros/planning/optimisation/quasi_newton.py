"""The SR1 quasi-Newton approximation of the curvature of max terms and constraints."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.optimisation.linearisation import Linearisation
from ff_planner_ros.planning.optimisation.qp import Step

# An SR1 update by a step that is so nearly orthogonal to it is rounding.
_ORTHOGONAL = 1e-8


def sr1_update(curvature: Array, at_x: Linearisation, at_trial: Linearisation, step: Step) -> Array:
    """Return the curvature of max terms and constraints, updated by one step (SR1).

    It approximates the Hessian of their sum, weighted by the step's multipliers; shape (variables,
    variables). Without max terms it is unchanged: the Gauss-Newton Hessian of f is better alone.
    """
    if not at_x.max_terms.size:
        return curvature
    y = (at_trial.max_terms_jacobian - at_x.max_terms_jacobian).T @ step.max_term_multipliers
    multipliers = step.constraint_multipliers
    (active,) = np.nonzero(multipliers)
    if len(at_x.names):
        before, after = _same_names(at_x.names[active], at_trial.names)
        before = active[before]
        change = at_trial.constraints_jacobian[after] - at_x.constraints_jacobian[before]
        y -= change.T @ multipliers[before]
    residual = y - curvature @ step.dx
    along = float(residual @ step.dx)
    if abs(along) <= _ORTHOGONAL * np.linalg.norm(residual) * np.linalg.norm(step.dx):
        return curvature
    updated: Array = curvature + np.outer(residual, residual) / along
    return updated


def _same_names(few: Indices, many: Indices) -> tuple[Indices, Indices]:
    """Return where names that are in both arrays first are in either, in the names' order."""
    order_of_few, order = few.argsort(kind="stable"), many.argsort(kind="stable")
    few, many = few[order_of_few], many[order]
    place = many.searchsorted(few)
    in_both = place < many.searchsorted(few, side="right")
    in_both[1:] &= few[1:] != few[:-1]
    return order_of_few[in_both], order[place[in_both]]
