"""The quadratic subproblem of an SQP step, solved by an interior-point method (PIQP).

    minimise    grad f' d + d' H d / 2 + t + penalty s   over the step d, t and the slack s >= 0
    subject to  p + P d <= t,  g + G d + s >= 0,  h + E d = 0,  max |d| <= radius

The max terms are in epigraph form. Elastic mode: if the linearised equalities have no solution
within the trust region, the same slack relaxes them to either side. Their multipliers are then not
reliable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

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
# The working set begins with the constraints and max terms that a step can reach by this part of
# the largest change in the trust region.
_WITHIN_REACH = 0.03
# Of 65 Newton steps from where a constraint was nearer than this, 63 were not the solution.
_IN_THE_WAY = 1e-3
# Of 2,000 programs with equalities, six rounds left 28 undecided; no weight is above 1e6 times the
# least.
_REWEIGHTED, _LEAST, _ROUNDING = 6, 1e-6, 1e-9


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
    step = _newton_step(at_x, radius)
    if step is None and not _is_out_of_reach(at_x, radius):
        step = _solve_by_working_set(at_x, radius, penalty)
    if step is not None:
        return step
    step = _solve_by_working_set(elastic_mode(at_x), radius, penalty)
    if step is None:  # nothing but slack is asked for
        raise RuntimeError("a program without equalities has a solution")
    return replace(step, is_elastic=True)


def _newton_step(at_x: Linearisation, radius: float) -> Step | None:
    """Return the step that keeps the equalities alone; None: it is too long, or more is needed.

    If the step keeps constraints and trust region, it is the solution, found in a third of the
    time: their multipliers are zero.
    """
    if at_x.max_terms.size or (at_x.constraints < _IN_THE_WAY).any():
        return None
    missing = _INSIDE - at_x.constraints
    n, equal = len(at_x.gradient), _equalities_jacobian(at_x)
    kkt = np.zeros((n + len(equal), n + len(equal)))
    kkt[:n, :n] = at_x.hessian + _REGULARISATION * np.eye(n)
    kkt[n:, :n], kkt[:n, n:] = equal, equal.T
    try:
        found = np.linalg.solve(kkt, -np.concatenate([at_x.gradient, at_x.equalities]))
    except np.linalg.LinAlgError:  # the equalities depend on each other
        return None
    dx, multipliers = found[:n], found[n:]
    change = at_x.constraints_jacobian @ dx
    if not (np.abs(dx).max() < radius and (change >= missing).all()):
        return None
    step = _step(
        at_x, dx, at_x.constraints + change, np.zeros_like(missing), np.empty(0), multipliers
    )
    return step if step.violation <= FEASIBILITY_TOLERANCE else None


def _is_out_of_reach(at_x: Linearisation, radius: float) -> bool:
    """Tell whether the equalities surely have no solution in the trust region.

    By Farkas' lemma they have none if |y' h| exceeds the radius times the 1-norm of E' y for any y.
    Iteratively reweighted least squares looks for it, and for a solution. The interior-point method
    would end such a program after up to 250 iterations, where others take 15.
    """
    off, by_x = at_x.equalities, _equalities_jacobian(at_x)
    weights = np.ones(by_x.shape[1])
    for _ in range(_REWEIGHTED if off.size else 0):
        weighted = by_x * weights
        try:
            y = np.linalg.solve(weighted @ by_x.T, off)
        except np.linalg.LinAlgError:
            return False
        along = np.abs(by_x.T @ y)
        if (weights * along).max() <= radius:
            return False
        if y @ off > (1.0 + _ROUNDING) * radius * along.sum():
            return True
        weights = 1.0 / np.maximum(along, _LEAST * along.max())
    return False


def elastic_mode(at_x: Linearisation) -> Linearisation:
    """Return a linearisation whose equalities are pairs of constraints, which the slack relaxes."""
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
    """Return the solution with all constraints and max terms; None: the equalities have none.

    Constraints and max terms that a step hardly reaches join the working set only if the solution
    without them violates or exceeds them.
    """
    jacobian, missing = at_x.constraints_jacobian, _INSIDE - at_x.constraints
    of_max, below_largest = at_x.max_terms_jacobian, _largest(at_x) - at_x.max_terms
    working = missing > -_WITHIN_REACH * radius * np.abs(jacobian).sum(axis=1)
    leading = below_largest <= _WITHIN_REACH * radius * np.abs(of_max).sum(axis=1)
    program = _QuadraticProgram.of(at_x, radius, penalty)
    while True:
        (working_set,), (leading_set,) = np.nonzero(working), np.nonzero(leading)
        result = program.solve(at_x, working_set, leading_set)
        if result is None:
            return None
        solution = result.x
        dx, t, slack = solution[: program.variables], float(solution[-2]), float(solution[-1])
        change = jacobian @ dx
        violated = ~working & (change + slack < missing)
        exceeding = ~leading & (of_max @ dx > t + below_largest)
        if not (violated.any() or exceeding.any()):
            multipliers = np.maximum(result.z_u, 0.0)
            on_constraints, on_max_terms = np.zeros(len(missing)), np.zeros(len(below_largest))
            on_constraints[working_set] = multipliers[: len(working_set)]
            on_max_terms[leading_set] = multipliers[len(working_set) :]
            linearised = at_x.constraints + change
            return _step(at_x, dx, linearised, on_constraints, on_max_terms, result.y)
        working |= violated
        leading |= exceeding


def _step(
    at_x: Linearisation,
    dx: Array,
    linearised: Array,
    on_constraints: Array,
    on_max_terms: Array,
    on_equalities: Array,
) -> Step:
    """Return a solution as a step.

    Args:
        linearised: All constraints at its end, linearised.
        on_constraints: Multipliers of all constraints.
        on_max_terms: Multipliers of all max terms.
        on_equalities: Multipliers of the equalities.
    """
    equal_jacobian = _equalities_jacobian(at_x)
    lagrangian = (
        at_x.gradient
        - at_x.constraints_jacobian.T @ on_constraints
        + at_x.max_terms_jacobian.T @ on_max_terms
        + equal_jacobian.T @ on_equalities
    )
    below_largest = _largest(at_x) - at_x.max_terms
    complementarity = np.concatenate(
        [on_constraints * np.maximum(at_x.constraints, 0.0), on_max_terms * below_largest]
    )
    model = at_x.value + float(at_x.gradient @ dx + 0.5 * dx @ at_x.hessian @ dx)
    if at_x.max_terms.size:
        model += float((at_x.max_terms + at_x.max_terms_jacobian @ dx).max())
    return Step(
        dx=dx,
        objective=model,
        violation=violation(linearised, at_x.equalities + equal_jacobian @ dx),
        constraint_multipliers=on_constraints,
        equality_multipliers=on_equalities,
        max_term_multipliers=on_max_terms,
        optimality=float(max(np.abs(lagrangian).max(), complementarity.max(initial=0.0))),
    )


class _QuadraticProgram(NamedTuple):
    """The program over (d, t, s) without constraints and max terms, which working sets choose."""

    hessian: Array
    gradient: Array
    equal_rows: Array
    lower: Array
    upper: Array

    @staticmethod
    def of(at_x: Linearisation, radius: float, penalty: float) -> _QuadraticProgram:
        """Return the program of a model in the trust region."""
        n, max_terms = len(at_x.gradient), len(at_x.max_terms)
        hessian = np.zeros((n + 2, n + 2))
        hessian[:n, :n] = at_x.hessian
        hessian.flat[:: n + 3] += _REGULARISATION  # the diagonal
        hessian[n:, n:] *= _LINEAR
        gradient = np.concatenate([at_x.gradient, [1.0 if max_terms else 0.0, penalty]])
        equal_rows = np.zeros((len(at_x.equalities), n + 2))
        equal_rows[:, :n] = _equalities_jacobian(at_x)
        largest = _largest(at_x)
        lower, upper = np.full(n + 2, -radius), np.full(n + 2, radius)
        lower[n:] = -max(abs(largest), 1.0) if max_terms else 0.0, 0.0
        upper[n:] = np.inf if max_terms else 0.0, np.inf
        return _QuadraticProgram(hessian, gradient, equal_rows, lower, upper)

    @property
    def variables(self) -> int:
        """Number of entries of d."""
        return len(self.gradient) - 2

    def solve(self, at_x: Linearisation, working_set: Indices, leading_set: Indices) -> Any | None:
        """Return PIQP's result; None: the equalities have no solution."""
        n, constraints = self.variables, len(working_set)
        rows = np.empty((constraints + len(leading_set), n + 2))
        np.negative(at_x.constraints_jacobian[working_set], out=rows[:constraints, :n])
        rows[:constraints, n], rows[:constraints, n + 1] = 0.0, -1.0
        rows[constraints:, :n] = at_x.max_terms_jacobian[leading_set]
        rows[constraints:, n], rows[constraints:, n + 1] = -1.0, 0.0
        # Max terms are measured from the present largest, so that t stays small.
        below_largest = _largest(at_x) - at_x.max_terms[leading_set]
        upper = np.concatenate([at_x.constraints[working_set] - _INSIDE, below_largest])
        equal = at_x.equalities
        solver = piqp.DenseSolver()
        solver.settings.verbose = False
        solver.setup(
            self.hessian,
            self.gradient,
            self.equal_rows if equal.size else None,
            -equal if equal.size else None,
            rows,
            None,
            upper,
            self.lower,
            self.upper,
        )
        status = solver.solve()
        return None if equal.size and status != piqp.PIQP_SOLVED else solver.result


def _largest(at_x: Linearisation) -> float:
    return float(at_x.max_terms.max()) if at_x.max_terms.size else 0.0


def _equalities_jacobian(at_x: Linearisation) -> Array:
    return at_x.equalities_jacobian.reshape(len(at_x.equalities), len(at_x.gradient))
