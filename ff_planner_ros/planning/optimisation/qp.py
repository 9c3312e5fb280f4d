"""The quadratic subproblem of an SQP step, solved by an interior-point method (PIQP).

    minimise    grad f' d + d' H d / 2 + t + penalty s   over the step d, t and the slack s >= 0
    subject to  p + P d <= t,  g + G d + s >= 0,  h + E d = 0,  max |d| <= radius

The max terms are in epigraph form. Elastic mode: where the linearised equalities have no solution
within the trust region, the same slack lets them be violated either way. Their multipliers are not
to be trusted then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import piqp

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.optimisation.linearisation import (
    FEASIBILITY_TOLERANCE,
    Linearisation,
    violation,
)

# Steps aim this far inside, so that whole steps keep a curved constraint, not only tiny ones.
_INSIDE = 5.0 * FEASIBILITY_TOLERANCE
# Makes the quadratic programs strictly convex; the objective's own curvature is of order 1. The
# epigraph variable and the slack are linear, and have this part of it.
_REGULARISATION, _LINEAR = 1e-4, 1e-4
# The working set begins with the constraints that a step reaches by this part of what it might, if
# it went to every bound.
_WITHIN_REACH = 0.03


@dataclass(frozen=True, eq=False)
class Step:
    """Solution of a quadratic subproblem."""

    dx: Array  # shape (variables,)
    objective: float  # of the model at the end of the step
    violation: float  # of the linearised constraints there
    # Shape (constraints,); behind them, in elastic mode, those of both sides of each equality
    constraint_multipliers: Array
    equality_multipliers: Array  # shape (equalities,), in elastic mode (0,)
    max_term_multipliers: Array  # shape (max terms,)
    optimality: float  # first-order optimality at the step's beginning, with its multipliers
    is_elastic: bool = False


def solve_qp(at_x: Linearisation, radius: float, penalty: float) -> Step:
    """Return the step that minimises the model of the merit function in the trust region."""
    step = _solve_by_working_set(at_x, radius, penalty)
    if step is not None:
        return step
    step = _solve_by_working_set(elastic_mode(at_x), radius, penalty)
    if step is None:  # nothing but slack is asked for
        raise RuntimeError("a program without equalities has a solution")
    return replace(step, is_elastic=True)


def elastic_mode(at_x: Linearisation) -> Linearisation:
    """Return functions whose equalities are pairs of constraints, which may be violated."""
    off, by_x = at_x.equalities, at_x.equalities_jacobian
    return Linearisation(
        at_x.value,
        at_x.gradient,
        at_x.hessian,
        at_x.max_terms,
        at_x.max_terms_jacobian,
        np.concatenate([at_x.constraints, off, -off]),
        np.concatenate([at_x.constraints_jacobian, by_x, -by_x]),
    )


def _solve_by_working_set(at_x: Linearisation, radius: float, penalty: float) -> Step | None:
    """Return the solution with all constraints; None: the equalities have none.

    A constraint that a step hardly reaches joins the working set only where the solution without
    it violates it.
    """
    jacobian, missing = at_x.constraints_jacobian, _INSIDE - at_x.constraints
    working = missing > -_WITHIN_REACH * radius * np.abs(jacobian).sum(axis=1)
    while True:
        (working_set,) = np.nonzero(working)
        found = _solve_subset(at_x, working_set, radius, penalty)
        if found is None:
            return None
        step, slack = found
        violated = ~working & (jacobian @ step.dx + slack < missing)
        if not violated.any():
            return step
        working |= violated


def _solve_subset(
    at_x: Linearisation, working_set: Indices, radius: float, penalty: float
) -> tuple[Step, float] | None:
    """Return the solution with the constraints of the working set alone, and its slack."""
    result = _interior_point(at_x, working_set, radius, penalty)
    if result is None:
        return None
    n, constraints = len(at_x.gradient), len(working_set)
    dx, multipliers = result.x[:n], np.maximum(result.z_u, 0.0)
    on_constraints, on_max_terms = np.zeros(len(at_x.constraints)), multipliers[constraints:]
    on_constraints[working_set] = multipliers[:constraints]
    equal_jacobian = _equalities_jacobian(at_x)
    lagrangian = (
        at_x.gradient
        - at_x.constraints_jacobian.T @ on_constraints
        + at_x.max_terms_jacobian.T @ on_max_terms
        + equal_jacobian.T @ result.y
    )
    below_largest = _largest(at_x) - at_x.max_terms
    complementarity = np.concatenate(
        [on_constraints * np.maximum(at_x.constraints, 0.0), on_max_terms * below_largest]
    )
    model = at_x.value + float(at_x.gradient @ dx + 0.5 * dx @ at_x.hessian @ dx)
    if at_x.max_terms.size:
        model += float((at_x.max_terms + at_x.max_terms_jacobian @ dx).max())
    step = Step(
        dx=dx,
        objective=model,
        violation=violation(
            at_x.constraints + at_x.constraints_jacobian @ dx,
            at_x.equalities + equal_jacobian @ dx,
        ),
        constraint_multipliers=on_constraints,
        equality_multipliers=result.y,
        max_term_multipliers=on_max_terms,
        optimality=float(max(np.abs(lagrangian).max(), complementarity.max(initial=0.0))),
    )
    return step, float(result.x[n + 1])


def _interior_point(
    at_x: Linearisation, working_set: Indices, radius: float, penalty: float
) -> Any | None:
    """Return PIQP's result over (d, t, s); None: the equalities have no solution."""
    n, max_terms, constraints = len(at_x.gradient), len(at_x.max_terms), len(working_set)
    hessian = np.zeros((n + 2, n + 2))
    hessian[:n, :n] = at_x.hessian
    hessian.flat[:: n + 3] += _REGULARISATION  # the diagonal
    hessian[n:, n:] *= _LINEAR
    gradient = np.concatenate([at_x.gradient, [1.0 if max_terms else 0.0, penalty]])
    rows = np.zeros((constraints + max_terms, n + 2))
    rows[:constraints, :n] = -at_x.constraints_jacobian[working_set]
    rows[:constraints, n + 1] = -1.0
    rows[constraints:, :n] = at_x.max_terms_jacobian
    rows[constraints:, n] = -1.0
    # Max terms are measured from the present largest, so that t stays small.
    largest = _largest(at_x)
    upper = np.concatenate([at_x.constraints[working_set] - _INSIDE, largest - at_x.max_terms])
    lowest_t = -max(abs(largest), 1.0) if max_terms else 0.0
    equal = at_x.equalities
    equal_rows = np.zeros((len(equal), n + 2))
    equal_rows[:, :n] = _equalities_jacobian(at_x)
    bound = np.full(n, radius)

    solver = piqp.DenseSolver()
    solver.settings.verbose = False
    solver.setup(
        hessian,
        gradient,
        equal_rows if equal.size else None,
        -equal if equal.size else None,
        rows,
        None,
        upper,
        np.concatenate([-bound, [lowest_t, 0.0]]),
        np.concatenate([bound, [np.inf if max_terms else 0.0, np.inf]]),
    )
    status = solver.solve()
    return None if equal.size and status != piqp.PIQP_SOLVED else solver.result


def _largest(at_x: Linearisation) -> float:
    return float(at_x.max_terms.max()) if at_x.max_terms.size else 0.0


def _equalities_jacobian(at_x: Linearisation) -> Array:
    return at_x.equalities_jacobian.reshape(len(at_x.equalities), len(at_x.gradient))
