"""A trust-region SQP method: minimise f(x) + max_j p_j(x)  subject to  g(x) >= 0, h(x) = 0.

Each iteration solves a convex quadratic program by an interior-point method (PIQP): the
Gauss-Newton Hessian of f, the peaks p in epigraph form with a curvature learned from the steps
before, the constraints linearised with one elastic slack, the step bounded by the trust region. A
step is taken when the exact L-infinity merit function confirms what the quadratic program promised.

The linearised equalities hold without slack where the trust region has room for it, or else with
the same slack either way: their multipliers are not to be trusted then. Where a step brings little
because the equalities are curved, another one corrects what they became at its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np
import piqp

from ff_planner_ros.common.arrays import Array, Indices

# A constraint violated by less counts as kept [unit of g]; well below any tolerance that a
# user sets, well above the accuracy of the quadratic programs.
FEASIBILITY_TOLERANCE = 1e-6

# Steps aim this far inside, so that whole steps keep a curved constraint, not only tiny ones.
_INSIDE = 5.0 * FEASIBILITY_TOLERANCE

# Trust region, infinity norm, in units of x. The end effector path's coefficients are metres and
# radians: half a unit is a bold first step, four are more than any arm's workspace has room for.
FIRST_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 0.5, 4.0, 1e-7
# A step of this part of the radius is limited by it.
_AT_BOUND = 0.9
# Price of a violated constraint in the merit function: where it begins, its bounds, its steps.
_FIRST_PRICE, _LOWEST_PRICE, _HIGHEST_PRICE, _DEARER = 10.0, 1e-2, 1e5, 100.0
# The merit function is exact above the multipliers' sum; the markup leaves them room to grow.
_MARKUP, _HARDLY_MORE = 2.0, 1.1
# Makes the quadratic programs strictly convex; the objective's own curvature is of order 1.
_REGULARISATION = 1e-4
# Constraints that a step reaches by this part of what it might, if it went to every bound, are
# looked at first.
_WITHIN_REACH = 0.03
# Where the violation does not fall to this part of itself in so many iterations, it stays; but a
# small one [unit of g] only waits for the trust region to become as small.
_STUCK, _PATIENCE, _SMALL_VIOLATION = 0.7, 4, 2e-3
# A smaller promise is rounding; no step can be judged by it.
_LEAST_PROMISE = 1e-12
# The objective is known to six good digits where no step promises a tenth of the sixth: what the
# steps after it would bring, too, is not ten times as much.
_SIX_DIGITS = 1e-7
# A smaller multiplier is the interior-point method's way of writing zero.
_INACTIVE = 1e-9
# An update of the curvature by a step that is so nearly orthogonal to it is rounding.
_ORTHOGONAL = 1e-8
# A step is taken if it brings this part of the promised decrease; the trust region shrinks below
# the second value and grows above the third.
_ACCEPT, _SHRINK, _GROW = 0.1, 0.25, 0.7
# On the way to the nearest feasible x: the first trust region, and a price that buys feasibility
# at any length of step.
_RESTORING_RADIUS, _RESTORING_PRICE = 0.2, 1e3


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The functions and their first derivatives at one x."""

    value: float  # f
    gradient: Array  # of f; shape (variables,)
    hessian: Array  # positive semidefinite approximation for f; shape (variables, variables)
    peaks: Array  # p; shape (peaks,), may be empty
    peaks_jacobian: Array  # shape (peaks, variables)
    constraints: Array  # g; shape (constraints,), may be empty
    constraints_jacobian: Array  # shape (constraints, variables)
    equalities: Array = field(default_factory=lambda: np.empty(0))  # h; may be empty
    # Shape (equalities, variables); ignored where there are none
    equalities_jacobian: Array = field(default_factory=lambda: np.empty((0, 0)))
    # Of the constraints, those of interest at x: at another x the same name is the same constraint
    names: Indices = field(default_factory=lambda: np.empty(0, np.intp))
    is_defined: bool = True  # whether the functions are defined at x; if not, only x has a meaning

    @property
    def objective(self) -> float:
        """Sum of f and the largest peak."""
        return self.value + (float(self.peaks.max()) if self.peaks.size else 0.0)

    @property
    def violation(self) -> float:
        """By how much the worst constraint is violated; zero if none is."""
        return _violation(self.constraints, self.equalities) if self.is_defined else np.inf


AtX = TypeVar("AtX", bound=Linearisation)


@dataclass(frozen=True, eq=False)
class Solution(Generic[AtX]):
    """Where the solver stopped."""

    x: Array  # shape (variables,)
    at_x: AtX  # functions and derivatives there
    # Largest entry of the Lagrangian's gradient, or of a constraint times its multiplier
    optimality: float
    # No constraint is violated, and the objective is known to six good digits
    converged: bool
    iterations: int  # quadratic programs solved
    evaluations: int  # calls of the function
    stop_reason: str  # a sentence
    # Of peaks and constraints as their multipliers weigh them, learned from the steps; shape
    # (variables, variables), None if unknown
    curvature: Array | None = None
    radius: float = FIRST_RADIUS  # of the trust region, to go on with

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
    first_radius: float = FIRST_RADIUS,
    curvature: Array | None = None,
    tolerated: float = 0.0,
    here: AtX | None = None,
) -> Solution[AtX]:
    """Minimise from a start; not converging is a result, not an error.

    Args:
        linearise: Returns functions and derivatives at x; no step leads to where they are not.
        tolerance: First-order optimality at which to stop.
        progress: Part of the objective; a step that promises less is not worth an evaluation.
        first_radius: Largest entry of the first step: small where the start is nearly optimal.
        curvature: Of peaks and constraints, as another solution learned it. None: nothing is known.
        tolerated: A smaller violation does not stop a step that brings what it promised of the
            objective: long steps along curved constraints. The solution may violate as much. Where
            it is not zero, a violation that no longer falls does not end the search.
        here: Functions and derivatives at the start. None: they are asked for.
    """
    x, here = start, linearise(start) if here is None else here
    if curvature is None:
        curvature = np.zeros((len(x), len(x)))
    if not here.is_defined:
        return Solution(x, here, np.inf, False, 0, 0, "the functions are not defined at the start")
    radius, price = first_radius, _FIRST_PRICE
    evaluations, optimality = 1, np.inf
    violations = [here.violation]
    converged, reason = False, f"stopped after {max_iterations} iterations, before convergence"
    iterations = 0
    while iterations < max_iterations:
        iterations += 1
        step, price = _step_at_fair_price(_curved(here, curvature), radius, price)
        optimality = step.optimality
        promised = here.objective - step.objective + price * (here.violation - step.violation)
        length = float(np.abs(step.dx).max())
        free = length < _AT_BOUND * radius
        enough = _enough(here, step, promised, free, tolerance, progress)
        if enough is not None:
            converged, reason = enough
            break
        trial = _tried(linearise, x, here, step, radius, price, promised, tolerated)
        there, step, ratio = trial.there, trial.step, trial.ratio
        evaluations += trial.evaluations
        if there.is_defined:
            curvature = _learned(curvature, here, there, step)
        if ratio > _ACCEPT:
            x, here, optimality = x + step.dx, there, np.nan
        radius = _next_radius(radius, ratio, float(np.abs(step.dx).max()))
        violations += [here.violation] * _tells_of_violation(here, step, ratio)
        if not tolerated and _is_stuck(violations):
            reason = "stuck: the violation of the constraints no longer falls"
            break
        if radius < _SMALLEST_RADIUS:
            reason = "stalled: no step within the smallest trust region brings progress"
            break
    if not np.isfinite(optimality):  # that of x is not known yet
        optimality = _step_at_fair_price(here, FIRST_RADIUS, price)[0].optimality
    return Solution(
        x, here, optimality, converged, iterations, evaluations, reason, curvature, radius
    )


def nearest_feasible(
    linearise: Callable[[Array], AtX], start: Array, here: AtX, max_iterations: int
) -> Solution[AtX]:
    """Go to the nearest x that keeps every constraint, whatever the objective is there.

    Each step is the shortest one that keeps the linearised constraints: near a feasible x the
    violation falls quadratically, where `minimise` would trade it for the objective.

    Args:
        here: Functions and derivatives at the start.
    """
    x, radius, iterations, evaluations = start, _RESTORING_RADIUS, 0, 0
    while here.violation > FEASIBILITY_TOLERANCE and iterations < max_iterations:
        iterations += 1
        model = replace(
            here,
            gradient=np.zeros(len(x)),
            hessian=np.eye(len(x)),
            peaks=here.peaks[:0],
            peaks_jacobian=here.peaks_jacobian[:0],
        )
        dx = _solve_quadratic_program(model, radius, _RESTORING_PRICE).dx
        there = linearise(x + dx)
        evaluations += there.is_defined
        if there.violation < here.violation:
            x, here = x + dx, there
        else:
            radius = _SHRINK * float(np.abs(dx).max())
    optimality = _step_at_fair_price(here, FIRST_RADIUS, _FIRST_PRICE)[0].optimality
    reason = "good enough: the nearest that keeps the constraints to where the solver came"
    return Solution(x, here, optimality, False, iterations, evaluations, reason)


@dataclass(frozen=True, eq=False)
class _Trial(Generic[AtX]):
    """Where a step leads."""

    there: AtX
    step: _Step
    ratio: float  # what part it brought of what was promised
    evaluations: int


def _tried(
    linearise: Callable[[Array], AtX],
    x: Array,
    here: AtX,
    step: _Step,
    radius: float,
    price: float,
    promised: float,
    tolerated: float,
) -> _Trial[AtX]:
    """Try a step and, where it brings little, the one that knows how the equalities are curved."""
    there = linearise(x + step.dx)
    gained = _gained(here, there, price)
    ratio = _part_brought(here, there, step, gained, promised, tolerated)
    first = _Trial(there, step, ratio, int(there.is_defined))
    if ratio >= _SHRINK or not there.is_defined or not here.equalities.size:
        return first
    curved = there.equalities - here.equalities_jacobian @ step.dx
    dx = _solve_quadratic_program(replace(here, equalities=curved), radius, price).dx
    beyond = linearise(x + dx)
    better = _gained(here, beyond, price)
    if better <= max(gained, 0.0):
        return replace(first, evaluations=1 + beyond.is_defined)
    corrected = replace(step, dx=dx)
    ratio = _part_brought(here, beyond, corrected, better, promised, tolerated)
    return _Trial(beyond, corrected, ratio, 2)


def _next_radius(radius: float, ratio: float, length: float) -> float:
    """Return the trust region after a step that brought a part of what it promised."""
    if ratio < _SHRINK:
        return 0.4 * length
    if ratio > _GROW and length > _AT_BOUND * radius:
        return min(2.0 * radius, _LARGEST_RADIUS)
    return radius


def _enough(
    here: Linearisation,
    step: _Step,
    promised: float,
    free: bool,
    tolerance: float,
    progress: float,
) -> tuple[bool, str] | None:
    """Return whether the solver has converged, and why it stops here; None: it goes on.

    Args:
        promised: By the step.
        free: Whether the trust region leaves the step free.
    """
    if here.violation > FEASIBILITY_TOLERANCE:
        return None
    if step.optimality <= tolerance:
        enough = f"first-order optimality is within {tolerance:g}"
    elif free and promised <= progress * abs(here.objective):
        enough = f"no step promises more than {progress:g} of the objective"
    else:
        return None
    known = max(_SIX_DIGITS * abs(here.objective), _LEAST_PROMISE)
    converged = free and bool(abs(promised) <= known)
    return converged, f"{'converged' if converged else 'good enough'}: {enough}"


def _curved(here: AtX, curvature: Array) -> AtX:
    """Return functions and derivatives with the learned curvature in the Hessian."""
    if not here.peaks.size:
        return here
    values, vectors = np.linalg.eigh(here.hessian + curvature)
    return replace(here, hessian=(vectors * np.maximum(values, 0.0)) @ vectors.T)


def _learned(curvature: Array, here: Linearisation, there: Linearisation, step: _Step) -> Array:
    """Return the curvature of peaks and constraints, updated by one step (SR1).

    It is that of their sum as the step's multipliers weigh them. A sum f alone has a Gauss-Newton
    approximation that is better than what is learned.
    """
    if not here.peaks.size:
        return curvature
    turned = (there.peaks_jacobian - here.peaks_jacobian).T @ step.on_peaks
    (active,) = np.nonzero(step.on_constraints[: len(here.constraints)] > _INACTIVE)
    if len(here.names):
        _, before, after = np.intersect1d(here.names[active], there.names, return_indices=True)
        before = active[before]
        bent = there.constraints_jacobian[after] - here.constraints_jacobian[before]
        turned -= bent.T @ step.on_constraints[before]
    missing = turned - curvature @ step.dx
    along = float(missing @ step.dx)
    if abs(along) <= _ORTHOGONAL * np.linalg.norm(missing) * np.linalg.norm(step.dx):
        return curvature
    learned: Array = curvature + np.outer(missing, missing) / along
    return learned


def _gained(here: Linearisation, there: Linearisation, price: float) -> float:
    """Return by how much the merit function falls; where nothing is defined, it never does."""
    if not there.is_defined:
        return -np.inf
    return (here.objective - there.objective) + price * (here.violation - there.violation)


def _part_brought(
    here: Linearisation,
    there: Linearisation,
    step: _Step,
    gained: float,
    promised: float,
    tolerated: float,
) -> float:
    """Return what part a step brought of what it promised.

    Args:
        gained: Of the merit function.
        promised: Of the merit function.
        tolerated: While the violation is smaller, the step may be judged by the objective alone.
    """
    ratio = gained / promised if promised > _LEAST_PROMISE else -np.inf
    fall = here.objective - step.objective
    if fall > _LEAST_PROMISE and max(here.violation, there.violation) <= tolerated:
        ratio = max(ratio, (here.objective - there.objective) / fall)
    return ratio


def _step_at_fair_price(here: Linearisation, radius: float, price: float) -> tuple[_Step, float]:
    """Return a step, and the price of a violated constraint by which to judge it.

    It is the lowest that leaves hardly more of the violation than any price would; where
    nothing is left, the price follows the multipliers. Too high a price makes the solver refuse
    good steps along curved constraints.
    """
    hard = _solved(here, radius, price) if here.equalities.size else None
    if hard is None and here.equalities.size:
        here = _elastic(here)
    steps = [hard or _solve_quadratic_program(here, radius, price)]
    prices = [price]
    while steps[-1].violation > FEASIBILITY_TOLERANCE and prices[-1] < _HIGHEST_PRICE:
        prices.append(_DEARER * prices[-1])
        steps.append(_solve_quadratic_program(here, radius, prices[-1]))
    enough = max(_HARDLY_MORE * steps[-1].violation, FEASIBILITY_TOLERANCE)
    step, price = next(
        pair for pair in zip(steps, prices, strict=True) if pair[0].violation <= enough
    )
    if step.violation > FEASIBILITY_TOLERANCE:
        return step, price
    pull = float(step.on_constraints.sum() + np.abs(step.on_equalities).sum())
    return step, max(_MARKUP * pull, _LOWEST_PRICE)


def _tells_of_violation(here: Linearisation, step: _Step, ratio: float) -> bool:
    """Tell whether the violation after a step says that it will not become zero.

    With equalities the first steps are often too long, and not taken; and while the linearised
    ones can hold, the violation only waits for the objective.
    """
    if not here.equalities.size:
        return True
    return bool(ratio > _ACCEPT and step.violation > FEASIBILITY_TOLERANCE)


def _is_stuck(violations: list[float]) -> bool:
    """Tell from the violation at each iteration whether it will not become zero."""
    if len(violations) <= _PATIENCE or min(violations) <= FEASIBILITY_TOLERANCE:
        return False
    return violations[-1] > max(_SMALL_VIOLATION, _STUCK * violations[-1 - _PATIENCE])


@dataclass(frozen=True, eq=False)
class _Step:
    """Solution of a quadratic program."""

    dx: Array  # the step; shape (variables,)
    objective: float  # promised at the end of the step
    violation: float  # what remains of the linearised one
    # Multipliers of the constraints, shape (constraints,); behind them those of equalities that
    # could not hold, as pairs of constraints
    on_constraints: Array
    on_equalities: Array  # of those that hold; shape (equalities,) or (0,)
    on_peaks: Array  # multipliers of the peaks; shape (peaks,)
    optimality: float  # first-order optimality at the step's beginning, with its multipliers


def _solve_quadratic_program(here: Linearisation, radius: float, price: float) -> _Step:
    """Minimise the model of the merit function over (dx, peak, slack)."""
    if here.equalities.size:
        hard = _solved(here, radius, price)
        if hard is not None:
            return hard
        here = _elastic(here)
    elastic = _solved(here, radius, price)
    if elastic is None:  # nothing but slack is asked for
        raise RuntimeError("a program without equalities has a solution")
    return elastic


def _elastic(here: Linearisation) -> Linearisation:
    """Return functions whose equalities are pairs of constraints, which may be violated."""
    off, by_x = here.equalities, here.equalities_jacobian
    return Linearisation(
        here.value,
        here.gradient,
        here.hessian,
        here.peaks,
        here.peaks_jacobian,
        np.concatenate([here.constraints, off, -off]),
        np.concatenate([here.constraints_jacobian, by_x, -by_x]),
    )


def _solved(here: Linearisation, radius: float, price: float) -> _Step | None:
    """Solve it with equalities that hold; None: within the trust region they cannot.

    Most constraints do not matter: those that a step hardly reaches join only where the solution
    without them violates them. The solution is that with all of them.
    """
    jacobian, missing = here.constraints_jacobian, _INSIDE - here.constraints
    kept = missing > -_WITHIN_REACH * radius * np.abs(jacobian).sum(axis=1)
    while True:
        (rows,) = np.nonzero(kept)
        found = _solved_among(here, rows, radius, price)
        if found is None:
            return None
        step, slack = found
        late = ~kept & (jacobian @ step.dx + slack < missing)
        if not late.any():
            return step
        kept |= late


def _solved_among(
    here: Linearisation, kept: Indices, radius: float, price: float
) -> tuple[_Step, float] | None:
    """Return the solution that looks at some constraints only, and its slack."""
    equal, equal_jacobian = here.equalities, here.equalities_jacobian
    equalities = len(equal)
    n, peaks, constraints = len(here.gradient), len(here.peaks), len(kept)
    hessian = np.zeros((n + 2, n + 2))
    hessian[:n, :n] = here.hessian
    hessian.flat[:: n + 3] += _REGULARISATION  # the diagonal
    hessian[n:, n:] *= 1e-4  # peak and slack are linear; the solver wants some curvature
    gradient = np.concatenate([here.gradient, [1.0 if peaks else 0.0, price]])
    # Peaks are measured from the present largest, so that the epigraph variable stays small.
    top = here.peaks.max() if peaks else 0.0
    rows = np.zeros((constraints + peaks, n + 2))
    rows[:constraints, :n] = -here.constraints_jacobian[kept]
    rows[:constraints, n + 1] = -1.0
    rows[constraints:, :n] = here.peaks_jacobian
    rows[constraints:, n] = -1.0
    upper = np.concatenate([here.constraints[kept] - _INSIDE, top - here.peaks])
    bound = np.full(n, radius)
    equal_rows = np.zeros((equalities, n + 2))
    if equalities:
        equal_rows[:, :n] = equal_jacobian
    lowest_peak = -max(abs(float(top)), 1.0) if peaks else 0.0

    solver = piqp.DenseSolver()
    solver.settings.verbose = False
    solver.setup(
        hessian,
        gradient,
        equal_rows if equalities else None,
        -equal if equalities else None,
        rows,
        None,
        upper,
        np.concatenate([-bound, [lowest_peak, 0.0]]),
        np.concatenate([bound, [np.inf if peaks else 0.0, np.inf]]),
    )
    status = solver.solve()
    if equalities and status != piqp.PIQP_SOLVED:
        return None
    result = solver.result
    dx = result.x[:n]
    multipliers = np.maximum(result.z_u, 0.0)
    on_constraints, on_peaks = np.zeros(len(here.constraints)), multipliers[constraints:]
    on_constraints[kept] = multipliers[:constraints]
    lagrangian = (
        here.gradient
        - here.constraints_jacobian.T @ on_constraints
        + here.peaks_jacobian.T @ on_peaks
    )
    on_equalities = result.y if equalities else equal
    if equalities:
        lagrangian = lagrangian + equal_jacobian.T @ on_equalities
    complementarity = np.concatenate(
        [on_constraints * np.maximum(here.constraints, 0.0), on_peaks * (top - here.peaks)]
    )
    peak = float((here.peaks + here.peaks_jacobian @ dx).max()) if peaks else 0.0
    step = _Step(
        dx=dx,
        objective=here.value + float(here.gradient @ dx + 0.5 * dx @ here.hessian @ dx) + peak,
        violation=_violation(
            here.constraints + here.constraints_jacobian @ dx,
            equal + equal_jacobian @ dx if equalities else equal,
        ),
        on_constraints=on_constraints,
        on_equalities=on_equalities,
        on_peaks=on_peaks,
        optimality=float(max(np.abs(lagrangian).max(), complementarity.max(initial=0.0))),
    )
    return step, float(result.x[n + 1])


def _violation(constraints: Array, equalities: Array) -> float:
    """Return by how much the worst constraint is below zero, or the worst equality is off it."""
    below = -constraints.min(initial=0.0)
    return float(max(0.0, below, np.abs(equalities).max(initial=0.0)))
