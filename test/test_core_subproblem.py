"""Steps of the subproblem against the conditions of an optimum, which a convex program needs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.optimisation.linearisation import Linearisation
from ff_planner_ros.planning.optimisation.qp import Step, solve_qp
from ff_planner_ros.planning.optimisation.solver import minimise

# What the subproblem adds to the Hessian, and how far inside the constraints a step aims.
REGULARISATION, INSIDE = 1e-4, 5e-6
RADIUS = 0.5


def random_model(seed: int, off: float = 0.1, size: float = 1.0) -> Linearisation:
    """Draw a model with constraints, with equalities that are so far off, and with max terms.

    Args:
        size: Of the largest entry of the Hessian, beside one.
    """
    rng = np.random.default_rng(seed)
    n, count = int(rng.integers(8, 30)), int(rng.integers(0, 60))
    equalities, max_terms = int(rng.integers(0, 4)), int(rng.integers(0, 30)) * (seed % 2)
    root = rng.normal(size=(n // 2, n))
    root[0] *= np.sqrt(size)
    return Linearisation(
        1.0,
        rng.normal(size=n),
        root.T @ root / n,  # of half of the rank
        rng.normal(size=max_terms),
        rng.normal(size=(max_terms, n)),
        rng.uniform(-0.3, 1.0, count),
        rng.normal(size=(count, n)),
        off * rng.normal(size=equalities),
        rng.normal(size=(equalities, n)),
        names=rng.permutation(3 * count)[:count],
    )


def models() -> Iterator[tuple[Linearisation, float]]:
    """Yield models and penalties."""
    for seed in range(300):
        size = (1.0, 1.0, 1e4, 1e8)[seed % 4]
        yield random_model(seed, 0.05 if seed % 3 else 20.0, size), (0.1, 10.0, 1e3)[seed % 3]


def assert_is_optimal(at_x: Linearisation, penalty: float, step: Step) -> None:
    """Compare a step with the conditions of Karush, Kuhn and Tucker, written out for (d, t, s)."""
    d, on = step.dx, step.constraint_multipliers
    on_max, off_by = step.max_term_multipliers, at_x.equalities + at_x.equalities_jacobian @ d
    assert np.abs(d).max() <= RADIUS + 1e-9
    reached = at_x.constraints + at_x.constraints_jacobian @ d - INSIDE
    missed = np.abs(off_by) + INSIDE if step.is_elastic else np.zeros(0)
    slack = max(0.0, -reached.min(initial=0.0), missed.max(initial=0.0))
    if not step.is_elastic:
        np.testing.assert_allclose(off_by, 0.0, atol=1e-8)
    # Who is not the largest, or not at its limit, has no multiplier.
    scale = 1.0 + np.abs(at_x.gradient).max() + penalty
    terms = at_x.max_terms + at_x.max_terms_jacobian @ d
    assert min(on.min(initial=0.0), on_max.min(initial=0.0)) >= 0.0
    assert (on * (reached + slack)).max(initial=0.0) < 1e-7 * scale
    if terms.size:
        largest = at_x.max_terms.max()
        lowest = largest - max(abs(largest), 1.0)  # no step is rewarded for more
        assert (on_max * (max(terms.max(), lowest) - terms)).max() < 1e-7 * scale
        if terms.max() > lowest + 1e-6:
            assert on_max.sum() == pytest.approx(1.0, abs=1e-6)
    on_slack = on.sum() + (np.abs(step.equality_multipliers).sum() if step.is_elastic else 0.0)
    assert on_slack <= penalty + 1e-6
    if slack > 1e-6:
        assert on_slack == pytest.approx(penalty, abs=1e-6)
    rest = at_x.gradient + at_x.hessian @ d + REGULARISATION * d - at_x.constraints_jacobian.T @ on
    rest += (
        at_x.max_terms_jacobian.T @ on_max + at_x.equalities_jacobian.T @ step.equality_multipliers
    )
    inner, scale = np.abs(d) < RADIUS - 1e-7, scale + (np.abs(at_x.hessian) @ np.abs(d)).max()
    np.testing.assert_allclose(rest[inner], 0.0, atol=1e-7 * scale)
    assert (rest * np.sign(d))[~inner].max(initial=0.0) <= 1e-7 * scale


def test_steps_keep_the_conditions_of_karush_kuhn_and_tucker() -> None:
    active = at_bounds = elastic = relaxed = 0
    for at_x, penalty in models():
        step = solve_qp(at_x, RADIUS, penalty)
        assert_is_optimal(at_x, penalty, step)
        active += np.count_nonzero(step.constraint_multipliers)
        at_bounds += np.count_nonzero(np.abs(step.dx) > RADIUS - 1e-9)
        elastic += step.is_elastic
        relaxed += step.violation > 1e-3
    assert active > 1000
    assert at_bounds > 500
    assert elastic > 50
    assert relaxed > 50


def test_steps_of_a_search_of_the_least_attitude_keep_them_too() -> None:
    """Many rows, of which a step without bounds violates most, and an objective nearly linear."""
    n, rows, max_terms, equalities = 56, 400, 80, 17
    for seed in range(10):
        rng = np.random.default_rng(seed)
        root = 0.1 * rng.normal(size=(n, n))
        root[:, :3] = 0.0  # axes without curvature
        by_x = rng.normal(size=(rows, n))
        # Pairs of rows that nearly depend on each other.
        by_x[rows // 2 :] = by_x[: rows - rows // 2] + 1e-7 * by_x[rows // 2 :]
        at_x = Linearisation(
            1.0,
            np.zeros(n),
            root.T @ root / n,
            rng.normal(size=max_terms),
            rng.normal(size=(max_terms, n)),
            rng.uniform(-0.05, 1.0, rows),
            by_x,
            0.05 * rng.normal(size=equalities),
            rng.normal(size=(equalities, n)),
        )
        step = solve_qp(at_x, RADIUS, 10.0)
        assert np.count_nonzero(step.constraint_multipliers) > 5
        assert_is_optimal(at_x, 10.0, step)
        again = solve_qp(at_x, RADIUS, 10.0, solve_qp(at_x, 0.1 * RADIUS, 10.0).working_set)
        assert_is_optimal(at_x, 10.0, again)
        np.testing.assert_allclose(again.dx, step.dx, atol=1e-6)


def test_a_guess_changes_nothing_but_the_way_to_the_step() -> None:
    """That of the step itself, of another penalty and radius, and of other constraints."""
    rng = np.random.default_rng(0)
    for at_x, penalty in models():
        step = solve_qp(at_x, RADIUS, penalty)
        renamed = replace(at_x, names=rng.permutation(at_x.names))
        for other in (at_x, renamed):
            for radius, other_penalty in ((RADIUS, penalty), (0.01, 1e4)):
                guess = solve_qp(other, radius, other_penalty).working_set
                found = solve_qp(at_x, RADIUS, penalty, guess)
                assert found.is_elastic == step.is_elastic
                assert_is_optimal(at_x, penalty, found)


def test_a_guess_of_a_larger_program_is_taken_as_far_as_it_goes() -> None:
    wide, narrow = (random_model(seed) for seed in (3, 11))
    assert len(wide.gradient) > len(narrow.gradient)
    guess = solve_qp(wide, 1e-3, 10.0).working_set
    assert_is_optimal(narrow, 10.0, solve_qp(narrow, RADIUS, 10.0, guess))


def test_constraints_that_say_the_same_are_no_difficulty() -> None:
    """Each five times, and nearly so five times, as the distances of one body at many points."""
    rng = np.random.default_rng(0)
    for seed in range(60):
        at_x = random_model(seed)

        def many(values: Array) -> Array:
            nearly = 1e-10 * rng.normal(size=(5, *values.shape))
            return np.concatenate([*[values] * 5, *(values + nearly)])

        crowded = replace(
            at_x,
            constraints=many(at_x.constraints),
            constraints_jacobian=many(at_x.constraints_jacobian),
            names=np.arange(10 * len(at_x.names)),
        )
        first = solve_qp(crowded, RADIUS, 10.0)
        for step in (first, solve_qp(crowded, RADIUS, 10.0, first.working_set)):
            assert_is_optimal(crowded, 10.0, step)


def test_derivatives_of_any_size_leave_a_step_in_the_trust_region() -> None:
    """Beside a dynamic singularity those of a path are 1e9, and its Hessian 1e18."""
    for seed in range(60):
        at_x = random_model(seed)
        great = replace(
            at_x,
            gradient=1e8 * at_x.gradient,
            hessian=1e18 * at_x.hessian,
            constraints_jacobian=1e9 * at_x.constraints_jacobian,
        )
        assert np.abs(solve_qp(great, RADIUS, 1e3).dx).max() <= RADIUS + 1e-9


def test_a_hessian_that_rounding_left_indefinite_is_made_positive_definite() -> None:
    for seed in range(60):
        at_x = random_model(seed)
        least = np.linalg.eigvalsh(at_x.hessian)[0]
        identity = np.eye(len(at_x.gradient))
        indefinite = replace(at_x, hessian=at_x.hessian - (least + 5e-3) * identity)
        step = solve_qp(indefinite, RADIUS, 10.0)
        made = replace(at_x, hessian=indefinite.hessian + 1e2 * REGULARISATION * identity)
        assert_is_optimal(made, 10.0, step)


def test_a_hessian_far_from_positive_semidefinite_leaves_no_step_and_the_solver_stalls() -> None:
    n = 5
    none = np.empty(0), np.empty((0, n))
    at_x = Linearisation(3.0, np.ones(n), -10.0 * np.eye(n), *none, *none)
    step = solve_qp(at_x, RADIUS, 10.0)
    assert not step.dx.any()
    assert (step.objective, step.violation, step.optimality) == (3.0, 0.0, 1.0)
    found = minimise(lambda _: at_x, np.zeros(n), 10, 1e-3, 1e-3)
    assert not found.converged
    assert found.stop_reason.startswith("stalled")
