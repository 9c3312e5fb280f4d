"""The dual active-set method against the conditions of an optimum, PIQP and linear programs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import piqp
import pytest
from scipy.optimize import linprog

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.optimisation import qp
from ff_planner_ros.planning.optimisation.linearisation import Linearisation

NOTHING = np.empty(0, np.intp)


def random_program(number: int) -> dict[str, Array]:
    """Draw a program; two in three have a solution."""
    rng = np.random.default_rng(number)
    n, count = int(rng.integers(2, 30)), int(rng.integers(0, 60))
    equalities = int(rng.integers(0, 1 + n // 3))
    root = rng.normal(size=(n, n))
    return {
        "hessian": root.T @ root / n + 1e-3 * np.eye(n),
        "gradient": rng.normal(size=n),
        "equal_rows": rng.normal(size=(equalities, n)),
        "equal": 0.3 * rng.normal(size=equalities),
        "rows": rng.normal(size=(count, n)),
        "least": rng.normal(size=count) - 0.5 * np.sqrt(n),
        "lower": -rng.uniform(0.2, 2.0, n),
        "upper": rng.uniform(0.2, 2.0, n),
    }


def has_solution(program: dict[str, Array]) -> bool:
    """Ask a linear program whether anything keeps the constraints."""
    n = len(program["gradient"])
    found = linprog(
        np.zeros(n),
        -program["rows"],
        -program["least"],
        program["equal_rows"],
        program["equal"],
        np.column_stack([program["lower"], program["upper"]]),
    )
    return bool(found.status == 0)


def solved_programs() -> Iterator[tuple[dict[str, Array], tuple[Array, ...]]]:
    """Yield programs and their solutions."""
    for number in range(300):
        program = random_program(number)
        found = compiled.solve_program(**program, guess=NOTHING)
        assert found is not None, number
        assert bool(found) == has_solution(program), number
        if found:
            yield program, found


def numbers_of(on_rows: Array, on_bounds: Array) -> Array:
    """Return the numbers of the constraints that have a multiplier."""
    on = np.concatenate([on_rows, np.maximum(on_bounds, 0.0), np.maximum(-on_bounds, 0.0)])
    return np.flatnonzero(on)


def test_a_solution_keeps_the_conditions_of_karush_kuhn_and_tucker() -> None:
    solved = active = 0
    for program, (x, on_equalities, on_rows, on_bounds) in solved_programs():
        gradient = program["gradient"] + program["hessian"] @ x
        of_constraints = program["equal_rows"].T @ on_equalities + program["rows"].T @ on_rows
        np.testing.assert_allclose(gradient, of_constraints + on_bounds, atol=1e-8)
        np.testing.assert_allclose(program["equal_rows"] @ x, program["equal"], atol=1e-9)
        slack = program["rows"] @ x - program["least"]
        above, below = x - program["lower"], program["upper"] - x
        assert min(slack.min(initial=0.0), above.min(), below.min()) >= -1e-9
        assert on_rows.min(initial=0.0) >= 0.0
        assert np.abs(on_rows * slack).max(initial=0.0) < 1e-8
        assert np.abs(np.where(on_bounds > 0.0, above, below) * on_bounds).max() < 1e-8
        solved, active = solved + 1, active + len(numbers_of(on_rows, on_bounds))
    assert solved > 150
    assert active > 5 * solved


def test_an_interior_point_method_finds_the_same() -> None:
    for program, (x, *_) in solved_programs():
        solver = piqp.DenseSolver()
        equalities = (program["equal_rows"], program["equal"])
        solver.setup(
            program["hessian"],
            program["gradient"],
            *(equalities if program["equal"].size else (None, None)),
            *((program["rows"], program["least"]) if program["least"].size else (None, None)),
            None,
            program["lower"],
            program["upper"],
        )
        assert solver.solve() == piqp.PIQP_SOLVED
        np.testing.assert_allclose(x, solver.result.x, atol=1e-4)


def test_a_guess_changes_nothing_but_the_way_to_the_solution() -> None:
    """Right, of anything at all, and of everything that there is."""
    rng = np.random.default_rng(1)
    for program, (x, _, *multipliers) in solved_programs():
        every = np.arange(len(program["least"]) + 2 * len(x))
        for guess in (numbers_of(*multipliers), rng.permutation(every)[:9], every):
            found = compiled.solve_program(**program, guess=guess)
            assert found
            np.testing.assert_allclose(found[0], x, atol=1e-7)


def test_a_program_that_is_not_strictly_convex_is_left_undecided() -> None:
    program = random_program(0)
    program["hessian"] = np.diag([1.0, -1.0] + [1.0] * (len(program["gradient"]) - 2))
    assert compiled.solve_program(**program, guess=NOTHING) is None


def random_model(seed: int, off: float) -> Linearisation:
    """Draw a model with constraints, equalities that are so far off, and max terms."""
    rng, n = np.random.default_rng(seed), 8
    root = rng.normal(size=(n, n))
    return Linearisation(
        1.0,
        rng.normal(size=n),
        root.T @ root / n + np.eye(n),
        rng.normal(size=5),
        rng.normal(size=(5, n)),
        rng.uniform(-0.3, 1.0, 20),
        rng.normal(size=(20, n)),
        off * rng.normal(size=2),
        rng.normal(size=(2, n)),
    )


@pytest.mark.parametrize("seed", range(20))
def test_where_rounding_leaves_a_step_undecided_the_interior_point_method_finds_it(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_reached = seed % 2 == 0
    at_x = random_model(seed, 0.1 if is_reached else 100.0)
    expected = qp.solve_qp(at_x, 0.5, 50.0)
    monkeypatch.setattr(compiled, "solve_program", lambda *_: None)
    found = qp.solve_qp(at_x, 0.5, 50.0)
    assert found.is_elastic == expected.is_elastic == (not is_reached)
    np.testing.assert_allclose(found.dx, expected.dx, atol=1e-5)
    for name in ("constraint_multipliers", "equality_multipliers", "max_term_multipliers"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-3)
    for name in ("constraints", "max_terms", "lower", "upper"):
        in_found, in_expected = (getattr(step.working_set, name) for step in (found, expected))
        assert set(in_expected) <= set(in_found)
        assert len(in_found) <= len(in_expected) + 1  # its zeros are a little above zero


def test_the_slack_leaves_a_step_whatever_rounding_says(monkeypatch: pytest.MonkeyPatch) -> None:
    at_x = qp.elastic_mode(random_model(0, 100.0))
    expected = qp.solve_qp(at_x, 0.5, 50.0)
    monkeypatch.setattr(compiled, "solve_program", lambda *_: False)
    np.testing.assert_allclose(qp.solve_qp(at_x, 0.5, 50.0).dx, expected.dx, atol=1e-5)
