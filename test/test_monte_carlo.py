"""Monte Carlo of a plan: against its linear prediction, brute force and textbook intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import robots
from scipy.spatial.transform import Rotation
from scipy.stats import binom
from shaped_problems import among_cubes

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.intervals import exact_interval
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.uncertainty import Uncertainty, directions, draws
from ff_planner_ros.planning.robust.base_spread import base_spread, tracked_motion
from ff_planner_ros.planning.robust.margins import (
    ATTITUDE,
    CLEARANCE,
    CORRIDOR,
    ROTATION,
    TORQUE,
    Margins,
    margins,
)
from ff_planner_ros.planning.robust.nearness import nearness
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.problems.twin import seen_from
from ff_planner_ros.simulation.monte_carlo import Compared, MonteCarlo, monte_carlo
from ff_planner_ros.simulation.torque_runs import torque_monte_carlo
from ff_planner_ros.simulation.tracked_runs import tracked_runs

NOTHING = Uncertainty(0.0, 0.0, angular_velocity=0.0)
BODIES = robots.CONFIG / "scenarios/lemur_capture_bodies.yaml"
PANELS = robots.CONFIG / "scenarios/panel_capture.yaml"


def number(found: MonteCarlo, name: str) -> Compared:
    return next(one for one in found.numbers if one.name == name)


@pytest.fixture(scope="module", params=["lines", "shapes", "lines and boxes", "panels"])
def planned(
    request: pytest.FixtureRequest, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> tuple[PlanningProblem, Plan]:
    """A capture with the arm's lines, and one with the robot's bodies; both among bodies, too.

    Those of the last one are fixed to a target that tumbles.
    """
    if request.param == "lines":
        return lemur_capture, lemur_plan
    if request.param == "lines and boxes":
        problem = among_cubes(lemur_capture)
    else:
        problem = load_scenario(PANELS if request.param == "panels" else BODIES)
    return problem, plan(problem, load_parameters().planner)


def run(
    planned: tuple[PlanningProblem, Plan],
    uncertainty: Uncertainty,
    total: int,
    seed: int = 0,
    limits: Limits | None = None,
) -> MonteCarlo:
    problem, made = planned
    asked = uncertainty, total, seed, limits or problem.limits
    return monte_carlo(problem.robot, made.trajectory, scene_of(problem), *asked)


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [
        (0, 10, 0.0, 0.3085),
        (1, 20, 0.0013, 0.2487),
        (5, 10, 0.1871, 0.8129),
        (10, 10, 0.6915, 1.0),
        (0, 500, 0.0, 1.0 - 0.025 ** (1 / 500)),
    ],
)
def test_intervals_are_those_of_clopper_and_pearson(
    count: int, total: int, low: float, high: float
) -> None:
    assert exact_interval(count, total) == pytest.approx((low, high), abs=5e-5)


def test_at_an_interval_s_ends_what_was_seen_is_as_rare_as_it_says() -> None:
    low, high = exact_interval(7, 300)
    assert binom.sf(6, 300, low) == pytest.approx(0.025)
    assert binom.cdf(7, 300, high) == pytest.approx(0.025)


@pytest.mark.law("PLAN-20")
def test_at_one_percent_the_linear_prediction_holds_within_a_tenth(
    planned: tuple[PlanningProblem, Plan],
) -> None:
    problem, made = planned
    turned = made.metrics.max_chaser_euler
    rotated = made.metrics.max_chaser_rotation
    limits = replace(
        problem.limits, chaser_attitude=1.001 * turned, chaser_rotation=1.001 * rotated
    )
    found = run(planned, Uncertainty(), 400, limits=limits)
    for one in found.numbers:
        assert one.linear is not None
        for name in ("rms", "std", "median", "percentile_95"):
            foretold = getattr(one.linear, name)
            assert getattr(one.runs, name) == pytest.approx(foretold, rel=0.1, abs=1e-5), one.name
    assert found.foretold_end_error is not None
    ends = [number(found, f"end_{name}_error").runs.rms for name in ("position", "orientation")]
    # So many runs alone are off by 3 %.
    assert ends == pytest.approx(found.foretold_end_error, rel=0.1)
    for violated in found.violations:
        assert violated.linear == pytest.approx(violated.count, abs=0.02 * found.total)


def test_a_tenth_of_the_errors_leaves_a_hundredth_of_the_difference(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """What is not linear is of second order: in the end errors of single runs."""
    off = []
    for size in (0.1, 0.01):
        wrong = Uncertainty(mass=size, inertia=size, angular_velocity=size * 1e-2)
        found = number(run((lemur_capture, lemur_plan), wrong, 20), "end_position_error")
        assert found.linear is not None
        off.append(abs(found.runs.rms - found.linear.rms) / found.linear.rms)
    assert off[1] < 0.2 * off[0]
    assert off[1] < 2e-3


def test_nothing_wrong_is_no_error_at_all(planned: tuple[PlanningProblem, Plan]) -> None:
    problem, made = planned
    found = run(planned, NOTHING, 2)
    assert number(found, "end_position_error").runs.largest < 1e-6
    assert number(found, "end_orientation_error").runs.largest < 1e-6
    # At the points and half-way: the certified clearance is a lower bound. Corners pass between.
    clearance, missed = (
        number(found, CLEARANCE).runs.least,
        1e-3 if all(one.is_sphere for one in problem.obstacles) else 2e-3,
    )
    assert made.metrics.min_clearance <= clearance < made.metrics.min_clearance + missed
    assert found.violations[-1].count == 0


def test_the_least_distance_of_a_run_is_that_of_all_lines_and_spheres(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    robot = lemur_capture.robot
    motion = tracked_motion(robot, lemur_plan.trajectory)
    scene = scene_of(lemur_capture).seen_from(motion.origin, motion.velocity)
    runs = tracked_runs(motion, draws(robot, Uncertainty(mass=0.2), range(4), 0))
    found = nearness(robot, motion.q, motion.time, scene).least(runs.rotations, runs.positions)
    for k in range(4):
        turns = Rotation.from_matrix(runs.rotations[:, k]).as_quat()
        q = np.hstack([runs.positions[:, k], turns, motion.q[:, 7:]])
        arm = arm_points(robot, q)
        distances = clearances(arm, motion.time, segments(arm), scene.obstacles).distance
        assert found[k] == pytest.approx(distances.min(), abs=1e-9)


def test_margins_change_as_the_finite_differences_of_runs(
    planned: tuple[PlanningProblem, Plan],
) -> None:
    """Of distances, of the chaser's angles and of the corridor, one error at a time."""
    problem, made = planned
    robot, motion = problem.robot, tracked_motion(problem.robot, made.trajectory)
    scene = replace(scene_of(problem), approach=Approach(np.array([1.0, 0.2, 0.1]), 0.3))
    scene = scene.seen_from(motion.origin, motion.velocity)
    limits = Limits(chaser_attitude=1.0, chaser_rotation=1.0)
    of = directions(robot, Uncertainty())
    near, spread = nearness(robot, motion.q, motion.time, scene), base_spread(motion, of)
    kept = {one.kind: one for one in margins(motion, scene, near, limits, of, spread)}
    assert set(kept) == {CLEARANCE, ATTITUDE, ROTATION, CORRIDOR, TORQUE}
    total = 40
    errors = draws(robot, Uncertainty(), range(total), 0).errors
    small = Uncertainty(*(1e-2 * value for value in vars(Uncertainty()).values()))
    runs = monte_carlo(
        robot,
        made.trajectory,
        replace(scene_of(problem), approach=scene.approach),
        small,
        total,
        limits=limits,
    )
    for kind, one in kept.items():
        found = number(runs, kind)
        assert found.linear is not None
        least = one.least(1e-2 * errors)
        assert found.linear.mean == pytest.approx(least.mean(), rel=1e-9)
        # A hundredth of the usual errors: second order is a ten-thousandth of them.
        scale = max(one.sigmas.max() * 1e-2, 1e-9)
        assert found.runs.mean == pytest.approx(found.linear.mean, abs=0.05 * scale), kind
        assert found.runs.std == pytest.approx(found.linear.std, abs=0.05 * scale), kind


def test_margins_and_their_deviations_are_the_same_from_any_inertial_frame(
    planned: tuple[PlanningProblem, Plan],
) -> None:
    """Turned, far from here and moving: the start has any attitude, and the scene drifts by."""
    problem, made = planned
    turn = Rotation.from_rotvec([0.4, 2.0, -1.0])
    place, drift = np.array([300.0, -200.0, 500.0]), np.array([3.0, -1.0, 2.0])
    there = seen_from(problem, pin.SE3(turn.as_matrix(), place), drift)
    plain, motion = made.trajectory, dict[str, Array]()
    for part in ("chaser", "ee"):
        at, attitude, moves, turns = (
            np.array(getattr(plain, f"{part}_{name}"))
            for name in ("positions", "quaternions_xyzw", "linear_velocities", "angular_velocities")
        )
        motion[f"{part}_positions"] = turn.apply(at) + place + plain.time[:, None] * drift
        motion[f"{part}_quaternions_xyzw"] = (turn * Rotation.from_quat(attitude)).as_quat()
        motion[f"{part}_linear_velocities"] = turn.apply(moves) + drift
        motion[f"{part}_angular_velocities"] = turn.apply(turns)
    of = directions(problem.robot, Uncertainty())
    limits, found = Limits(chaser_attitude=1.0, chaser_rotation=1.0), list[dict[str, Margins]]()
    for asked, trajectory in ((problem, plain), (there, replace(plain, **motion))):
        tracked = tracked_motion(problem.robot, trajectory)
        scene = replace(scene_of(asked), approach=Approach(np.array([1.0, 0.2, 0.1]), 0.3))
        scene = scene.seen_from(tracked.origin, tracked.velocity)
        near = nearness(problem.robot, tracked.q, tracked.time, scene)
        spread = base_spread(tracked, of)
        kept = margins(tracked, scene, near, limits, of, spread)
        every = Margins(
            "all distances",
            near.distance.ravel(),
            near.sigmas(spread.pose).reshape(-1, 1),
            np.zeros(near.distance.size, np.intp),
            np.zeros(near.distance.size),
        )
        found.append({one.kind: one for one in (*kept, every) if one.kind != CLEARANCE})
    here, other = found
    assert here.keys() == other.keys() >= {ATTITUDE, ROTATION, CORRIDOR, TORQUE}
    for kind, one in here.items():
        finite = np.isfinite(one.values)
        assert (np.isfinite(other[kind].values) == finite).all()
        assert other[kind].values[finite] == pytest.approx(one.values[finite], abs=1e-6), kind
        scale = 1e-5 * one.sigmas[finite].max()
        assert other[kind].sigmas[finite] == pytest.approx(one.sigmas[finite], abs=scale), kind


def test_more_runs_begin_with_the_fewer_ones(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    few = number(run((lemur_capture, lemur_plan), Uncertainty(), 3), "end_position_error").runs
    more = number(run((lemur_capture, lemur_plan), Uncertainty(), 260), "end_position_error").runs
    assert more.least <= few.least < few.largest <= more.largest


def test_torques_alone_go_further_astray_than_controlled_joints(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    robot, motion, scene = lemur_capture.robot, lemur_plan.trajectory, scene_of(lemur_capture)
    wrong = Uncertainty(friction=0.01, joint_velocity=1e-4)
    exact = torque_monte_carlo(robot, motion, scene, NOTHING, 1)
    assert number(exact, "end_position_error").runs.largest < 1e-5
    assert number(exact, "clearance").runs.least == pytest.approx(
        number(run((lemur_capture, lemur_plan), NOTHING, 1), "clearance").runs.least, abs=2e-4
    )
    torques = torque_monte_carlo(robot, motion, scene, wrong, 3)
    tracked = run((lemur_capture, lemur_plan), wrong, 3)
    errors = [number(one, "end_position_error").runs.rms for one in (torques, tracked)]
    assert errors[0] > errors[1] > 1e-4
    assert [one.kind for one in torques.violations] == ["clearance", "joint_positions", "any"]


@pytest.mark.parametrize(
    ("name", "value"),
    [("mass", -0.01), ("inertia", 1.5), ("angular_velocity", np.nan), ("friction", np.inf)],
)
def test_deviations_that_are_none_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=f"uncertainty.{name}"):
        Uncertainty(**{name: value})


def test_runs_and_seeds_that_are_none_are_refused_by_name(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    planned = lemur_capture, lemur_plan
    for total, seed, field in (
        (0, 0, "--monte-carlo"),
        (10**9, 0, "--monte-carlo"),
        (1, -1, "--seed"),
    ):
        with pytest.raises(InvalidInput, match=f"^{field} is ") as refused:
            run(planned, NOTHING, total, seed)
        assert refused.value.status is Status.OUT_OF_RANGE


def test_centres_of_mass_are_refused_where_torques_alone_are_given(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    wrong = Uncertainty(center_of_mass=1e-3)
    with pytest.raises(InvalidInput, match="center_of_mass") as refused:
        torque_monte_carlo(
            lemur_capture.robot, lemur_plan.trajectory, scene_of(lemur_capture), wrong, 1
        )
    assert refused.value.status is Status.UNSUPPORTED
