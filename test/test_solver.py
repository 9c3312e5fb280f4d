"""Optima known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import linprog, nnls

from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.optimisation import qp, solver
from ff_planner_ros.planning.optimisation.linearisation import Linearisation
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.optimisation.restoration import nearest_feasible
from ff_planner_ros.planning.optimisation.solver import minimise
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.problems.scenarios import scenario

NO_ROWS = (np.empty(0), np.empty((0, 2)))
NOWHERE = Linearisation(np.inf, np.zeros(2), np.zeros((2, 2)), *NO_ROWS, *NO_ROWS, is_defined=False)


def quadratic(x, target):
    """Half the squared distance from a target: value, gradient, Hessian."""
    return 0.5 * np.sum((x - target) ** 2), x - target, np.eye(len(x))


def test_an_unconstrained_least_squares_problem_ends_at_its_target():
    target = np.array([3.0, -7.0])
    solution = minimise(
        lambda x: Linearisation(*quadratic(x, target), *NO_ROWS, *NO_ROWS),
        np.zeros(2),
        50,
        1e-6,
        0.0,
    )
    assert solution.converged
    assert solution.x == pytest.approx(target, abs=1e-4)  # the regularisation, and no more
    assert solution.optimality <= 1e-6


def test_the_nearest_point_of_a_circle_is_found_from_inside_it():
    """Nearest to (2, 0) outside the unit circle around (2.2, 0.1): on the line of both."""
    target, center = np.array([2.0, 0.0]), np.array([2.2, 0.1])

    def linearise(x):
        offset = x - center
        distance = np.linalg.norm(offset)
        constraint = np.array([distance - 1.0]), (offset / distance)[None]
        return Linearisation(*quadratic(x, target), *NO_ROWS, *constraint)

    solution = minimise(linearise, np.array([2.0, 0.3]), 100, 1e-5, 0.0)
    away = (target - center) / np.linalg.norm(target - center)
    assert solution.converged
    assert solution.feasible
    assert solution.x == pytest.approx(center + away, abs=1e-4)


def test_the_nearest_point_of_a_body_of_a_thousand_faces_is_found():
    """There what is missing is a sum of the normals of the faces that it is on."""
    normals = np.random.default_rng(5).normal(size=(1000, 4))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for target in np.random.default_rng(6).normal(size=(5, 4)) * 3.0:

        def linearise(x, target=target):
            faces = 0.5 - normals @ x, -normals
            return Linearisation(*quadratic(x, target), np.empty(0), np.empty((0, 4)), *faces)

        found = minimise(linearise, np.zeros(4), 60, 1e-9, 0.0)
        assert found.feasible
        (on,) = np.nonzero(0.5 - normals @ found.x < 2e-5)
        missing = target - found.x
        assert nnls(normals[on].T, missing)[1] < 1e-3 * np.linalg.norm(missing), target


def test_a_pure_min_max_problem_ends_where_three_peaks_meet():
    """The smallest circle around three points: its centre is the circumcentre here."""
    points = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]])

    def linearise(x):
        offset = x - points
        distance = np.linalg.norm(offset, axis=1)
        flat = 0.0, np.zeros(2), np.zeros((2, 2))
        return Linearisation(*flat, distance, offset / distance[:, None], *NO_ROWS)

    solution = minimise(linearise, np.array([3.0, 2.5]), 100, 1e-8, 0.0)
    assert solution.converged
    assert solution.x == pytest.approx([2.0, 1.0], abs=1e-4)
    assert solution.at_x.objective == pytest.approx(np.sqrt(5.0), abs=1e-5)


def test_value_and_peaks_are_added():
    """Minimise x^2/2 + |x - 1| over the line: the optimum sits at the kink's edge, x = 1."""

    def linearise(x):
        value = 0.5 * x[0] ** 2, x.copy(), np.eye(1)
        max_terms = np.array([x[0] - 1.0, 1.0 - x[0]]), np.array([[1.0], [-1.0]])
        return Linearisation(*value, *max_terms, np.empty(0), np.empty((0, 1)))

    solution = minimise(linearise, np.array([-3.0]), 50, 1e-8, 0.0)
    assert solution.converged
    assert solution.x == pytest.approx([1.0], abs=1e-4)


def test_the_price_rises_until_the_constraint_is_kept():
    """The multiplier, 1000, is a hundred times the first price."""

    def linearise(x):
        value = 1000.0 * x[0], np.array([1000.0]), np.zeros((1, 1))
        return Linearisation(
            *value, np.empty(0), np.empty((0, 1)), np.array([x[0] - 1.0]), np.eye(1)
        )

    solution = minimise(linearise, np.array([5.0]), 60, 1e-5, 0.0)
    assert solution.converged
    assert solution.x == pytest.approx([1.0], abs=1e-5)  # steps aim a little inside
    assert solution.x[0] >= 1.0


def test_steps_along_a_curved_constraint_are_not_held_up_by_a_price_once_raised():
    """Around a thin ring, inward of which the search begins, to its lowest point."""

    def linearise(x):
        distance = np.linalg.norm(x)
        constraints = np.array([distance - 1.0, 1.001 - distance])
        normal = x / distance
        return Linearisation(
            0.01 * x[0],
            np.array([0.01, 0.0]),
            np.zeros((2, 2)),
            np.empty(0),
            np.empty((0, 2)),
            constraints,
            np.array([normal, -normal]),
        )

    solution = minimise(linearise, np.array([0.98, 0.2]), 60, 1e-5, 0.0)
    assert "first-order optimality is within" in solution.stop_reason
    assert solution.feasible
    assert solution.x == pytest.approx([-1.001, 0.0], abs=1e-3)


@pytest.mark.parametrize(("progress", "iterations"), [(1e-2, 2), (1e-3, 4)])
def test_a_step_that_promises_too_little_is_not_taken(progress, iterations):
    """The Hessian is twice the true one: each step goes half of the way."""

    def linearise(x):
        value, gradient, hessian = quadratic(x, np.array([0.4, 0.0]))
        return Linearisation(1.0 + value, gradient, 2.0 * hessian, *NO_ROWS, *NO_ROWS)

    solution = minimise(linearise, np.zeros(2), 60, 1e-12, progress)
    assert not solution.converged
    assert solution.iterations == iterations
    assert (
        solution.stop_reason
        == f"good enough: the predicted decrease is at most {progress:g} of the objective"
    )


@pytest.mark.parametrize(("progress", "creeps"), [(1e-2, True), (0.0, False)])
def test_steps_that_together_bring_hardly_anything_are_the_last(progress, creeps):
    """Each brings a fifth of what it promises, and the next is shorter: 0.0167 in all."""

    def linearise(x):
        gradient = np.array([-0.1, 0.0])
        return Linearisation(1.0 - 0.02 * x[0], gradient, np.zeros((2, 2)), *NO_ROWS, *NO_ROWS)

    solution = minimise(linearise, np.zeros(2), 60, 1e-12, progress)
    assert not solution.converged
    assert (solution.iterations == 8) == creeps
    assert (solution.stop is solver.Stop.CREEPING) == creeps
    assert solution.stop.is_good_enough == creeps


def test_what_is_known_at_the_start_is_not_asked_for_again():
    asked = []

    def linearise(x):
        asked.append(x)
        return Linearisation(*quadratic(x, np.array([0.4, 0.0])), *NO_ROWS, *NO_ROWS)

    start = np.zeros(2)
    cold = minimise(linearise, start, 60, 1e-12, 0.0)
    looks = len(asked)
    warm = minimise(linearise, start, 60, 1e-12, 0.0, at_start=linearise(start))
    assert len(asked) == 2 * looks
    assert (warm.x == cold.x).all()


def test_an_infeasible_problem_ends_as_a_result_with_least_violation():
    """With x >= 1 and x <= -1 the best that can be had is to miss both by 1."""

    def linearise(x):
        value = 0.0, np.zeros(1), np.zeros((1, 1))
        constraints = np.array([x[0] - 1.0, -1.0 - x[0]]), np.array([[1.0], [-1.0]])
        return Linearisation(*value, np.empty(0), np.empty((0, 1)), *constraints)

    solution = minimise(linearise, np.array([3.0]), 60, 1e-6, 0.0)
    assert not solution.converged
    assert not solution.feasible
    assert solution.at_x.violation == pytest.approx(1.0, abs=1e-5)


def test_a_refused_step_is_a_wall_that_the_search_stays_in_front_of():
    def linearise(x):
        if x[0] > 1.0:
            return NOWHERE
        return Linearisation(*quadratic(x, np.array([3.0, 0.0])), *NO_ROWS, *NO_ROWS)

    solution = minimise(linearise, np.zeros(2), 60, 1e-8, 0.0)
    assert not solution.converged
    assert 0.9 < solution.x[0] <= 1.0


def test_a_start_at_which_nothing_is_defined_is_a_result():
    solution = minimise(lambda _: NOWHERE, np.zeros(2), 5, 1e-6, 0.0)
    assert not solution.converged
    assert not solution.feasible
    assert solution.iterations == 0
    assert "not defined" in solution.stop_reason


def test_running_out_of_iterations_is_said():
    solution = minimise(
        lambda x: Linearisation(*quadratic(x, np.array([99.0, 0.0])), *NO_ROWS, *NO_ROWS),
        np.zeros(2),
        3,
        1e-8,
        0.0,
    )
    assert not solution.converged
    assert "3 iterations" in solution.stop_reason
    assert solution.iterations == 3
    # That of the x returned, not of the one before the last step.
    assert solution.optimality == pytest.approx(99.0 - solution.x[0], rel=1e-9)


@pytest.mark.parametrize("weights", [Objective(1.0, 0.0), Objective(1.0, 1.0), Objective(0.005, 1)])
@pytest.mark.parametrize(("robot", "number"), [("lemur", 4), ("arm6", 4)])
def test_converged_means_that_solving_on_changes_no_more_than_the_seventh_digit(
    weights, robot, number
):
    problem = replace(scenario("ordinary", robot, number, turned=False).problem, points=13)
    problem = replace(problem, objective=weights)
    family = end_effector_paths(problem)
    linearise = path_program(problem, family, load_parameters().planner).linearise
    for tolerance, progress in ((1e-3, 2e-5), (1e-9, 2e-5), (1e-9, 1e-8)):
        solution = minimise(linearise, np.zeros(18), 80, tolerance, progress)
        on = minimise(linearise, solution.x, 80, 1e-10, 1e-10)
        change = abs(on.at_x.objective / solution.at_x.objective - 1.0)
        told = f"{solution.stop_reason}; solved on, the objective changes by {change:.1e}"
        assert solution.converged == solution.stop_reason.startswith("converged"), told
        assert not solution.converged or change <= 1e-6, told
        assert not (progress == 1e-8 and solution.feasible and weights.chaser_attitude == 0.0) or (
            solution.converged
        ), told


def on_a_parabola(x):
    """Least x1 while x1 >= x0^2 - 1: a curved valley whose lowest point is (0, -1)."""
    constraint = np.array([x[1] - x[0] ** 2 + 1.0]), np.array([[-2.0 * x[0], 1.0]])
    max_terms = np.array([x[1]]), np.array([[0.0, 1.0]])
    return Linearisation(0.0, np.zeros(2), np.zeros((2, 2)), *max_terms, *constraint)


def test_the_nearest_feasible_point_is_where_the_normal_of_the_curve_leads():
    for distance in (0.1, 1e-2, 1e-3):
        on_curve, inward = np.array([1.0, 0.0]), np.array([-2.0, 1.0]) / np.sqrt(5.0)
        start = on_curve - distance * inward
        mended = nearest_feasible(on_a_parabola, start, on_a_parabola(start), 6)
        assert mended.feasible
        # The curve's normal is followed to first order of what is missing.
        assert mended.x == pytest.approx(on_curve, abs=distance**2 + 1e-4), distance


def test_a_tolerated_violation_lets_long_steps_along_a_curve_pass():
    """The example of Maratos, least at (1, 0) on the unit circle: each step leaves the circle."""

    def linearise(x):
        beside = x @ x - 1.0
        gradient = 4.0 * x - np.array([1.0, 0.0])
        constraints = np.array([beside, -beside]), np.array([2.0 * x, -2.0 * x])
        return Linearisation(2.0 * beside - x[0], gradient, np.eye(2), *NO_ROWS, *constraints)

    start = np.array([np.cos(1.5), np.sin(1.5)])
    angles = {}
    for tolerated in (0.0, 0.3):
        found = minimise(linearise, start, 5, 1e-6, 0.0, 0.5, None, tolerated)
        assert found.at_x.violation <= tolerated
        mended = nearest_feasible(linearise, found.x, found.at_x, 6)
        assert mended.feasible
        angles[tolerated] = np.arctan2(mended.x[1], mended.x[0])
    assert abs(angles[0.3]) < 0.6 < 1.4 < angles[0.0]


def test_where_a_violation_is_tolerated_a_winding_way_is_followed_to_its_end():
    """Towards (20, 0) along a sine curve, a millimetre wide, from beside it."""

    def linearise(x):
        beside = x[1] - np.sin(x[0])
        normal = np.array([-np.cos(x[0]), 1.0])
        constraints = np.array([beside + 1e-3, 1e-3 - beside]), np.array([normal, -normal])
        to_go = x[0] - 20.0
        gradient, hessian = np.array([0.1 * to_go, 0.0]), np.diag([0.1, 0.0])
        return Linearisation(0.05 * to_go**2, gradient, hessian, *NO_ROWS, *constraints)

    start = np.array([0.0, 0.01])
    found = minimise(linearise, start, 100, 1e-6, 1e-6, 0.3, None, 0.3)
    assert found.feasible, found.stop_reason
    assert found.x[0] == pytest.approx(20.0, abs=1e-4), found.stop_reason


def on_circle(x):
    """The distance to (2, 1), on the unit circle."""
    equality = np.array([x @ x - 1.0]), 2.0 * x[None]
    value = quadratic(x, np.array([2.0, 1.0]))
    return Linearisation(*value, *NO_ROWS, *NO_ROWS, *equality)


@pytest.mark.parametrize("start", [(0.1, -0.2), (3.0, 0.5), (-0.9, 0.1)])
def test_an_equality_holds_and_the_rest_is_as_good_as_it_leaves_it(start):
    """The nearest point of the circle is where the way to the target crosses it."""
    solution = minimise(on_circle, np.array(start), 60, 1e-9, 1e-14, 0.1)
    assert solution.feasible
    assert solution.x == pytest.approx(np.array([2.0, 1.0]) / np.sqrt(5.0), abs=1e-6)


def as_two_sided(linearise):
    """Equalities as inequalities to either side."""

    def two_sided(x):
        at_x = linearise(x)
        off, by_x = at_x.equalities, at_x.equalities_jacobian
        return replace(
            at_x,
            constraints=np.append(off, -off),
            constraints_jacobian=np.vstack([by_x, -by_x]),
            equalities=np.empty(0),
        )

    return two_sided


@pytest.mark.parametrize("angle", [0.5, 1.0, -1.0])
@pytest.mark.parametrize("tolerated", [0.0, 1e-9])
def test_second_order_corrections_let_full_steps_along_a_curved_equality_pass(angle, tolerated):
    """The example of Maratos, least at (1, 0) on the unit circle: each step leaves the circle."""

    def linearise(x):
        beside = x @ x - 1.0
        value = 2.0 * beside - x[0], 4.0 * x - np.array([1.0, 0.0]), np.eye(2)
        return Linearisation(*value, *NO_ROWS, *NO_ROWS, np.array([beside]), 2.0 * x[None])

    start = np.array([np.cos(angle), np.sin(angle)])
    solution = minimise(linearise, start, 8, 1e-6, 0.0, tolerated=tolerated)
    assert solution.converged
    assert solution.x == pytest.approx([1.0, 0.0], abs=1e-6)
    # As inequalities, which have no corrections.
    without = minimise(as_two_sided(linearise), start, 8, 1e-6, 0.0, tolerated=tolerated)
    assert abs(np.arctan2(without.x[1], without.x[0])) > 0.1


def test_a_second_order_correction_is_the_shortest_step_to_the_linearised_equalities():
    """It meets them, and has no part along which they do not change; the rows may depend."""
    rng = np.random.default_rng(13)
    for number in range(50):
        n, count = int(rng.integers(8, 60)), int(rng.integers(1, 8))
        rows, off = rng.normal(size=(count, n)), 1e-3 * rng.normal(size=count)
        if number % 2:
            rows, off = np.vstack([rows, rows[0]]), np.append(off, off[0])
        none, asked = (np.empty(0), np.empty((0, n))), []

        def linearise(x, asked=asked, off=off, rows=rows, none=none, n=n):
            """Away from the start the equalities are off: the objective pays for no step."""
            asked.append(x)
            off = off if x.any() else 0.0 * off
            return Linearisation(1e-9 * x[0], np.eye(n)[0], np.eye(n), *none, *none, off, rows)

        minimise(linearise, np.zeros(n), 1, 1e-6, 0.0, tolerated=1e-9)
        _, trial, corrected = asked
        correction = corrected - trial
        np.testing.assert_allclose(rows @ correction, -off, atol=1e-10, err_msg=str(number))
        along = null_space(rows).T @ correction
        np.testing.assert_allclose(along, 0.0, atol=1e-10, err_msg=str(number))


def test_a_correction_longer_than_its_step_is_not_tried():
    """Down the y axis on x / 1000 + y^2 = 0: the correction would be 1000 y^2 along x."""
    asked = []

    def linearise(x):
        asked.append(x)
        equality = np.array([1e-3 * x[0] + x[1] ** 2]), np.array([[1e-3, 2.0 * x[1]]])
        value = quadratic(x, np.array([1.0, -3.0]))
        return Linearisation(*value, *NO_ROWS, *NO_ROWS, *equality)

    minimise(linearise, np.zeros(2), 1, 1e-6, 0.0, tolerated=1e-9)
    assert len(asked) == 2
    assert np.abs(asked).max() <= 0.5


def test_equalities_and_inequalities_hold_together():
    """The line x + y = 1 and y >= 0.7, nearest to the origin: (0.3, 0.7)."""

    def linearise(x):
        above = np.array([x[1] - 0.7]), np.array([[0.0, 1.0]])
        line = np.array([x.sum() - 1.0]), np.ones((1, 2))
        return Linearisation(*quadratic(x, np.zeros(2)), *NO_ROWS, *above, *line)

    solution = minimise(linearise, np.array([5.0, -3.0]), 60, 1e-8, 1e-12)
    assert solution.feasible
    assert solution.x == pytest.approx([0.3, 0.7], abs=1e-5)


def test_equalities_that_cannot_hold_are_violated_evenly_and_said_to_be_stuck():
    """X = 0 and x = 1."""

    def linearise(x):
        equalities = np.array([x[0], x[0] - 1.0]), np.array([[1.0, 0.0], [1.0, 0.0]])
        return Linearisation(*quadratic(x, np.zeros(2)), *NO_ROWS, *NO_ROWS, *equalities)

    solution = minimise(linearise, np.array([4.0, 1.0]), 60, 1e-6, 1e-9)
    assert not solution.feasible
    assert solution.x[0] == pytest.approx(0.5, abs=1e-3)
    assert "stuck" in solution.stop_reason or "stalled" in solution.stop_reason


def test_curved_constraints_are_learned_of_while_equalities_are_out_of_reach():
    """Least x1 on the line x0 = 1 above a parabola, (1, 0), more than a trust region away."""

    def linearise(x):
        return replace(
            on_a_parabola(x),
            equalities=np.array([x[0] - 1.0]),
            equalities_jacobian=np.array([[1.0, 0.0]]),
            names=np.array([7]),
        )

    start = np.array([0.0, -0.5])
    solution = minimise(linearise, start, 60, 1e-6, 1e-12, 0.3)
    assert solution.feasible
    assert solution.x == pytest.approx([1.0, 0.0], abs=1e-4)
    # That of the parabola, as its multiplier of nearly one weighs it; the line has none.
    on_the_way = minimise(linearise, start, 2, 1e-6, 1e-12, 0.3)
    assert on_the_way.curvature == pytest.approx(np.diag([2.0, 0.0]), abs=0.1)


def test_the_nearest_feasible_point_of_equalities_is_found():
    start = np.array([0.65, 0.85])
    solution = nearest_feasible(on_circle, start, on_circle(start), 12)
    assert solution.feasible
    assert solution.x == pytest.approx(start / np.linalg.norm(start), abs=1e-3)


def test_a_step_is_that_of_all_max_terms():
    """The largest of many terms, most of them far below it: the linear program is the truth."""
    rng = np.random.default_rng(11)
    for _ in range(20):
        terms, by_x = rng.uniform(-3.0, 0.0, 40), rng.normal(size=(40, 3)) * 10.0
        terms[0], radius = 0.5, 0.3
        at_x = Linearisation(
            0.0,
            np.zeros(3),
            np.zeros((3, 3)),
            terms,
            by_x,
            np.empty(0),
            np.empty((0, 3)),
        )
        step = qp.solve_qp(at_x, radius, 10.0)
        truth = linprog(
            [0.0, 0.0, 0.0, 1.0],
            A_ub=np.column_stack([by_x, -np.ones(40)]),
            b_ub=-terms,
            bounds=[(-radius, radius)] * 3 + [(None, None)],
        )
        reached = float((terms + by_x @ step.dx).max())
        assert reached == pytest.approx(truth.fun, abs=2e-3)
        assert step.objective == pytest.approx(reached, abs=1e-9)


def test_equalities_are_relaxed_where_a_linear_program_says_that_they_are_out_of_reach():
    """The least radius with a solution is that of a linear program."""
    rng = np.random.default_rng(11)
    for number in range(200):
        count, n = int(rng.integers(1, 7)), int(rng.integers(8, 30))
        rows, off = rng.normal(size=(count, n)), rng.normal(size=count)
        # The least r with |d| <= r and rows d = -off, over (d, r).
        beyond = np.block([[np.eye(n), -np.ones((n, 1))], [-np.eye(n), -np.ones((n, 1))]])
        least = linprog(
            np.append(np.zeros(n), 1.0),
            beyond,
            np.zeros(2 * n),
            np.column_stack([rows, np.zeros(count)]),
            -off,
            (None, None),
        ).fun
        none = np.empty(0), np.empty((0, n))
        program = Linearisation(0.0, np.zeros(n), np.eye(n), *none, *none, off, rows)
        assert qp.solve_qp(program, 1.0001 * least, 10.0).is_elastic is False, number
        assert qp.solve_qp(program, 0.9999 * least, 10.0).is_elastic, number


def test_equalities_that_contradict_each_other_are_no_error():
    rows, off = np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([1.0, -1.0])
    program = Linearisation(0.0, np.zeros(2), np.eye(2), *NO_ROWS, *NO_ROWS, off, rows)
    assert qp.solve_qp(program, 10.0, 10.0).is_elastic
