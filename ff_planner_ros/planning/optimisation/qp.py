"""The quadratic subproblem of an SQP step.

    minimise    grad f' d + d' H d / 2 + t + penalty s   over the step d, t and the slack s >= 0
    subject to  p + P d <= t,  g + G d + s >= 0,  h + E d = 0,  max |d| <= radius

The max terms are in epigraph form. Elastic mode: if the linearised equalities have no solution
within the trust region, the same slack relaxes them to either side. Their multipliers are then not
reliable.

A dual active-set method solves it, from the working set of the step before. Where rounding leaves
that method without an answer, an interior-point method (PIQP) gives one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
import piqp

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
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
# A bound so far away is none, to PIQP too.
_UNBOUNDED = 1e30
# What PIQP gives a smaller multiplier is not in the working set.
_INACTIVE = 1e-6

# x, and the multipliers of equalities, rows and bounds as `compiled.solve_program` has them
_Solution: TypeAlias = tuple[Array, Array, Array, Array]


@dataclass(frozen=True, eq=False)
class WorkingSet:
    """What a step keeps with equality: where the next step's solution is looked for first."""

    constraints: Indices  # their names
    max_terms: Indices  # that are the largest
    lower: Indices  # entries of (d, t, s) at their lower bounds
    upper: Indices  # likewise


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
    working_set: WorkingSet
    is_elastic: bool = False


def solve_qp(
    at_x: Linearisation, radius: float, penalty: float, guess: WorkingSet | None = None
) -> Step:
    """Return the step that minimises the model of the merit function in the trust region.

    Args:
        guess: Of a step before, with the same variables. None: there is none.
    """
    step = _solve(at_x, radius, penalty, guess)
    if step is not None:
        return step
    step = _solve(elastic_mode(at_x), radius, penalty, guess)
    if step is None:  # nothing but slack is asked for
        raise RuntimeError("a program without equalities has a solution")
    return replace(step, is_elastic=True)


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
        names=np.concatenate([_names(at_x), -1 - np.arange(2 * len(off))]),
    )


def _solve(
    at_x: Linearisation, radius: float, penalty: float, guess: WorkingSet | None
) -> Step | None:
    """Return the solution; None: the equalities have none."""
    program = _QuadraticProgram.of(at_x, radius, penalty)
    found = compiled.solve_program(*program, _numbers(at_x, guess))
    # Without equalities the slack leaves a solution, whatever rounding says.
    if found is None or (found is False and not at_x.equalities.size):
        found = _by_interior_point(program)
    if not found:
        return None
    (solution, on_equalities, on_rows, on_bounds), n = found, len(at_x.gradient)
    dx, on_equalities = solution[:n], -on_equalities
    on_constraints, on_max_terms = np.split(on_rows, [len(at_x.constraints)])
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
        violation=violation(
            at_x.constraints + at_x.constraints_jacobian @ dx,
            at_x.equalities + equal_jacobian @ dx,
        ),
        constraint_multipliers=on_constraints,
        equality_multipliers=on_equalities,
        max_term_multipliers=on_max_terms,
        optimality=float(max(np.abs(lagrangian).max(), complementarity.max(initial=0.0))),
        working_set=WorkingSet(
            _names(at_x)[on_constraints > _INACTIVE],
            np.flatnonzero(on_max_terms > _INACTIVE),
            np.flatnonzero(on_bounds > _INACTIVE),
            np.flatnonzero(on_bounds < -_INACTIVE),
        ),
    )


class _QuadraticProgram(NamedTuple):
    """The program over x = (d, t, s) that `compiled.solve_program` solves."""

    hessian: Array
    gradient: Array
    equal_rows: Array
    equal: Array  # equal_rows x
    rows: Array  # of the constraints, then of the max terms
    least: Array  # that rows x may be
    lower: Array
    upper: Array

    @staticmethod
    def of(at_x: Linearisation, radius: float, penalty: float) -> _QuadraticProgram:
        """Return the program of a model in the trust region."""
        n, constraints, max_terms = len(at_x.gradient), len(at_x.constraints), len(at_x.max_terms)
        hessian = np.zeros((n + 2, n + 2))
        hessian[:n, :n] = at_x.hessian
        hessian.flat[:: n + 3] += _REGULARISATION  # the diagonal
        hessian[n:, n:] *= _LINEAR
        gradient = np.concatenate([at_x.gradient, [1.0 if max_terms else 0.0, penalty]])
        equal_rows = np.zeros((len(at_x.equalities), n + 2))
        equal_rows[:, :n] = _equalities_jacobian(at_x)
        rows = np.zeros((constraints + max_terms, n + 2))
        rows[:constraints, :n], rows[:constraints, n + 1] = at_x.constraints_jacobian, 1.0
        np.negative(at_x.max_terms_jacobian, out=rows[constraints:, :n])
        rows[constraints:, n] = 1.0
        # Max terms are measured from the present largest, so that t stays small.
        largest = _largest(at_x)
        least = np.concatenate([_INSIDE - at_x.constraints, at_x.max_terms - largest])
        lower, upper = np.full(n + 2, -radius), np.full(n + 2, radius)
        lower[n:] = -max(abs(largest), 1.0) if max_terms else 0.0, 0.0
        upper[n:] = _UNBOUNDED if max_terms else 0.0, _UNBOUNDED
        return _QuadraticProgram(
            hessian, gradient, equal_rows, -at_x.equalities, rows, least, lower, upper
        )


def _numbers(at_x: Linearisation, guess: WorkingSet | None) -> Indices:
    """Return a working set as numbers of constraints, as `compiled.solve_program` has them."""
    constraints, max_terms = len(at_x.constraints), len(at_x.max_terms)
    bounds, variables = constraints + max_terms, len(at_x.gradient) + 2
    if guess is None:  # t and s, which hardly have a curvature, begin at a bound
        return bounds + np.arange(variables - 2, variables)
    return np.concatenate(
        [
            # Half of the time of `np.isin`, for a few dozen names.
            np.flatnonzero((_names(at_x)[:, None] == guess.constraints).any(axis=1)),
            constraints + guess.max_terms[guess.max_terms < max_terms],
            bounds + guess.lower,
            bounds + variables + guess.upper,
        ]
    )


def _by_interior_point(program: _QuadraticProgram) -> _Solution | None:
    """Return PIQP's solution; None: the equalities have none."""
    solver = piqp.DenseSolver()
    solver.settings.verbose = False
    has_equalities = program.equal.size > 0
    solver.setup(
        program.hessian,
        program.gradient,
        program.equal_rows if has_equalities else None,
        program.equal if has_equalities else None,
        program.rows,
        program.least,
        None,
        program.lower,
        program.upper,
    )
    status = solver.solve()
    if has_equalities and status != piqp.PIQP_SOLVED:
        return None
    found = solver.result
    return found.x, -found.y, np.maximum(found.z_l, 0.0), found.z_bl - found.z_bu


def _names(at_x: Linearisation) -> Indices:
    """Return the names of the constraints; where they have none, their numbers."""
    count = len(at_x.constraints)
    return at_x.names if len(at_x.names) == count else np.arange(count)


def _largest(at_x: Linearisation) -> float:
    return float(at_x.max_terms.max()) if at_x.max_terms.size else 0.0


def _equalities_jacobian(at_x: Linearisation) -> Array:
    return at_x.equalities_jacobian.reshape(len(at_x.equalities), len(at_x.gradient))
