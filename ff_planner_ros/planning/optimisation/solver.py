"""A trust-region SQP method: minimise f(x) + max_j p_j(x)  subject to  g(x) >= 0, h(x) = 0.

Each iteration solves a quadratic subproblem (`qp`) with the Gauss-Newton Hessian of f and an SR1
approximation of the curvature of max terms and constraints. The exact L-infinity merit function
decides whether its step is taken, by the gain ratio. Where that is small because the equalities are
curved, a second-order correction is tried. Names are those of Nocedal and Wright, "Numerical
Optimization", chapters 6, 15 and 18.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Generic, TypeVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core.compiled import WorkingSet
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE, Linearisation
from ff_planner_ros.planning.optimisation.qp import Step, solve_qp
from ff_planner_ros.planning.optimisation.quasi_newton import sr1_update

# Trust region, infinity norm, in units of x. The end effector path's coefficients are metres and
# radians: half a unit is a bold first step, four are more than any arm's workspace has room for.
FIRST_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 0.5, 4.0, 1e-7
# A step of this part of the radius is limited by it.
_AT_BOUND = 0.9
# A step is taken if its gain ratio is above the first value; the trust region shrinks below the
# second, to this part of the step, and grows above the last.
_ACCEPT, _SHRINK, _SHRUNK, _GROW = 0.1, 0.25, 0.4, 0.7
# Penalty of the merit function: where it begins, its bounds, its steps.
_FIRST_PENALTY, _LOWEST_PENALTY, _HIGHEST_PENALTY, _PENALTY_FACTOR = 10.0, 1e-2, 1e5, 100.0
# The merit function is exact above the multipliers' sum; the markup leaves them room to grow.
_MARKUP, _HARDLY_MORE = 2.0, 1.1
# A violation that does not fall to this part of itself in this many iterations is stagnant; but a
# small one [unit of g] only waits for the trust region to become as small.
_STAGNANT, _PATIENCE, _SMALL_VIOLATION = 0.7, 4, 2e-3
# A smaller predicted reduction is rounding; no step can be judged by it.
_LEAST_REDUCTION = 1e-12
# If the mean of so many steps is below what each must predict, the solver creeps along a kink.
_CREEP = 8
CREEPING = f"good enough: {_CREEP} steps together brought hardly more"
# The objective is known to six digits if no step predicts a tenth of the sixth: all further steps
# together bring less than ten times as much.
_SIX_DIGITS = 1e-7

AtX = TypeVar("AtX", bound=Linearisation)


@dataclass(frozen=True, eq=False)
class Solution(Generic[AtX]):
    """Where the solver stopped."""

    x: Array  # shape (variables,)
    at_x: AtX  # functions and derivatives there
    optimality_at_x: Callable[[], float]  # computes `optimality`, which takes a while
    # Whether no constraint is violated, and the objective is known to six digits
    converged: bool
    iterations: int  # quadratic programs solved
    stop_reason: str  # a sentence
    # SR1 approximation of the Hessian of max terms and constraints, weighted by their multipliers;
    # shape (variables, variables), None if unknown
    curvature: Array | None = None
    radius: float = FIRST_RADIUS  # of the trust region at the end

    @cached_property
    def optimality(self) -> float:
        """Largest entry of the Lagrangian's gradient, or of a constraint times its multiplier."""
        return self.optimality_at_x()

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
    """
    x, at_x = start, linearise(start) if at_start is None else at_start
    if curvature is None:
        curvature = np.zeros((len(x), len(x)))
    if not at_x.is_defined:
        reason = "the functions are not defined at the start"
        return Solution(x, at_x, lambda: np.inf, False, 0, reason)
    penalty, optimality = _FIRST_PENALTY, np.inf
    violations, objectives = [at_x.violation], [np.nan] * _CREEP
    converged, reason = False, f"stopped after {max_iterations} iterations, before convergence"
    iterations, working_set = 0, None
    while iterations < max_iterations:
        objectives.append(at_x.objective if at_x.violation <= _SMALL_VIOLATION else np.nan)
        brought = abs(objectives[-1 - _CREEP] - at_x.objective)
        if brought <= _CREEP * progress * abs(at_x.objective):
            reason = CREEPING
            break
        iterations += 1
        model = _convex_model(at_x, curvature)
        step, penalty = _step_and_penalty(model, radius, penalty, working_set)
        optimality, working_set = step.optimality, step.working_set
        stop = _convergence(at_x, step, radius, penalty, tolerance, progress)
        if stop is not None:
            converged, reason = stop
            break
        trial = _trial(linearise, x, at_x, step, radius, penalty, tolerated)
        if trial.at_x.is_defined:
            curvature = sr1_update(curvature, at_x, trial.at_x, trial.step)
        if trial.gain_ratio > _ACCEPT:
            x, at_x, optimality = x + trial.step.dx, trial.at_x, np.nan
        radius = _next_radius(radius, trial)
        if _counts_for_stagnation(at_x, trial):
            violations.append(at_x.violation)
        failure = _failure(radius, [] if tolerated else violations)
        if failure is not None:
            reason = failure
            break
    optimality_at_x = partial(_optimality, at_x, penalty, optimality)
    return Solution(x, at_x, optimality_at_x, converged, iterations, reason, curvature, radius)


def _optimality(at_x: Linearisation, penalty: float, known: float) -> float:
    """Return the first-order optimality at x, if not known with the multipliers of a long step."""
    if np.isfinite(known):
        return known
    return _step_and_penalty(at_x, FIRST_RADIUS, penalty, None)[0].optimality


def _convex_model(at_x: AtX, curvature: Array) -> AtX:
    """Return functions whose Hessian has the SR1 curvature, made positive semidefinite."""
    if not at_x.max_terms.size:
        return at_x
    values, vectors = np.linalg.eigh(at_x.hessian + curvature)
    return replace(at_x, hessian=(vectors * np.maximum(values, 0.0)) @ vectors.T)


def _step_and_penalty(
    at_x: Linearisation, radius: float, penalty: float, guess: WorkingSet | None
) -> tuple[Step, float]:
    """Return a step, and the penalty of the merit function that judges it (penalty update).

    The penalty is the lowest that leaves hardly more of the linearised violation than the highest;
    if none is left, it follows the multipliers. Too high a penalty makes the solver refuse good
    steps along curved constraints.
    """
    steps, penalties = [solve_qp(at_x, radius, penalty, guess)], [penalty]
    while steps[-1].violation > FEASIBILITY_TOLERANCE and penalties[-1] < _HIGHEST_PENALTY:
        penalties.append(_PENALTY_FACTOR * penalties[-1])
        last = steps[-1]
        steps.append(solve_qp(at_x, radius, penalties[-1], last.working_set, last.is_elastic))
    enough = max(_HARDLY_MORE * steps[-1].violation, FEASIBILITY_TOLERANCE)
    step, penalty = next(
        pair for pair in zip(steps, penalties, strict=True) if pair[0].violation <= enough
    )
    if step.violation > FEASIBILITY_TOLERANCE:
        return step, penalty
    multipliers = step.constraint_multipliers.sum() + np.abs(step.equality_multipliers).sum()
    return step, max(_MARKUP * float(multipliers), _LOWEST_PENALTY)


def _convergence(
    at_x: Linearisation,
    step: Step,
    radius: float,
    penalty: float,
    tolerance: float,
    progress: float,
) -> tuple[bool, str] | None:
    """Return whether the solver has converged, and why it stops at x; None: it goes on."""
    if at_x.violation > FEASIBILITY_TOLERANCE:
        return None
    predicted = _reduction(at_x, step, penalty)
    is_interior = float(np.abs(step.dx).max()) < _AT_BOUND * radius
    if step.optimality <= tolerance:
        enough = f"first-order optimality is within {tolerance:g}"
    elif is_interior and step.dx.any() and predicted <= progress * abs(at_x.objective):
        enough = f"the predicted decrease is at most {progress:g} of the objective"
    else:
        return None
    known = max(_SIX_DIGITS * abs(at_x.objective), _LEAST_REDUCTION)
    converged = is_interior and bool(abs(predicted) <= known)
    return converged, f"{'converged' if converged else 'good enough'}: {enough}"


@dataclass(frozen=True, eq=False)
class _Trial(Generic[AtX]):
    """Where a step leads."""

    at_x: AtX
    step: Step
    gain_ratio: float


def _trial(
    linearise: Callable[[Array], AtX],
    x: Array,
    at_x: AtX,
    step: Step,
    radius: float,
    penalty: float,
    tolerated: float,
) -> _Trial[AtX]:
    """Try a step and, where its gain ratio is small, its second-order correction."""
    at_trial = linearise(x + step.dx)
    ratio = _gain_ratio(at_x, at_trial, step, penalty, tolerated)
    trial = _Trial(at_trial, step, ratio)
    if ratio >= _SHRINK or not at_trial.is_defined or not at_x.equalities.size:
        return trial
    if tolerated:
        correction = _shortest_correction(at_x, at_trial)
        # Of 215 corrections longer than their steps 5 were taken, of 2,866 others 1,484.
        if np.abs(correction).max() > np.abs(step.dx).max():
            return trial
        dx = step.dx + correction
    else:
        curved = at_trial.equalities - at_x.equalities_jacobian @ step.dx
        dx = solve_qp(replace(at_x, equalities=curved), radius, penalty, step.working_set).dx
    at_corrected = linearise(x + dx)
    first = _reduction(at_x, at_trial, penalty)
    if _reduction(at_x, at_corrected, penalty) <= max(first, 0.0):
        return trial
    corrected = step._replace(dx=dx)
    ratio = _gain_ratio(at_x, at_corrected, corrected, penalty, tolerated)
    return _Trial(at_corrected, corrected, ratio)


def _shortest_correction(at_x: Linearisation, at_trial: Linearisation) -> Array:
    """Return the shortest step that brings the equalities, as they are at a trial x, back to zero.

    Linearised where the trial step began. It looks at neither trust region nor constraints, and
    takes a tenth of a quadratic subproblem's time. Where violations on the way are tolerated, plans
    are as good; elsewhere it lost one that is hard to find.
    """
    shortest, *_ = np.linalg.lstsq(at_x.equalities_jacobian, -at_trial.equalities)
    return np.asarray(shortest, np.float64)


def _reduction(at_x: Linearisation, after: Linearisation | Step, penalty: float) -> float:
    """Return the reduction of the merit function: actual at another x, predicted by a step."""
    if not np.isfinite(after.violation):  # nothing is defined there
        return -np.inf
    return (at_x.objective - after.objective) + penalty * (at_x.violation - after.violation)


def _gain_ratio(
    at_x: Linearisation, at_trial: Linearisation, step: Step, penalty: float, tolerated: float
) -> float:
    """Return the actual over the predicted reduction.

    Args:
        tolerated: While the violation is smaller, the objective alone may judge the step.
    """
    predicted = _reduction(at_x, step, penalty)
    actual = _reduction(at_x, at_trial, penalty)
    ratio = actual / predicted if predicted > _LEAST_REDUCTION else -np.inf
    predicted = at_x.objective - step.objective
    if predicted > _LEAST_REDUCTION and max(at_x.violation, at_trial.violation) <= tolerated:
        ratio = max(ratio, (at_x.objective - at_trial.objective) / predicted)
    return ratio


def _next_radius(radius: float, trial: _Trial[AtX]) -> float:
    """Return the trust region after a trial."""
    length = float(np.abs(trial.step.dx).max())
    if trial.gain_ratio < _SHRINK:
        return _SHRUNK * length
    if trial.gain_ratio > _GROW and length > _AT_BOUND * radius:
        return min(2.0 * radius, _LARGEST_RADIUS)
    return radius


def _counts_for_stagnation(at_x: AtX, trial: _Trial[AtX]) -> bool:
    """Tell whether the violation after a trial counts in the test for a stagnant violation.

    With equalities the first steps are often too long, and not taken; and as long as the linearised
    constraints can hold, the violation may still fall.
    """
    if not at_x.equalities.size:
        return True
    return bool(trial.gain_ratio > _ACCEPT and trial.step.violation > FEASIBILITY_TOLERANCE)


def _failure(radius: float, violations: Sequence[float]) -> str | None:
    """Return why the solver gives up; None: it goes on.

    Args:
        violations: Those that count for stagnation, in order.
    """
    if (
        len(violations) > _PATIENCE
        and min(violations) > FEASIBILITY_TOLERANCE
        and violations[-1] > max(_SMALL_VIOLATION, _STAGNANT * violations[-1 - _PATIENCE])
    ):
        return "stuck: the violation of the constraints no longer falls"
    if radius < _SMALLEST_RADIUS:
        return "stalled: no step within the smallest trust region brings progress"
    return None
