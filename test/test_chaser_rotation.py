"""The angle of the chaser's rotation as a limit: the same in any frame, and kept at all times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import robots
from core_rows import sensitivity_of
from dense_motion import truth
from reference_goal_rows import huber
from reference_program import rows_of
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Parametrisation,
    PlanningProblem,
)
from ff_planner_ros.planning.requirements.limits.chaser_rotation import ChaserRotation
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.twin import seen_from
from ff_planner_ros.robot.quaternion import angle_of_quaternion

SETTINGS = load_parameters().planner
LENGTH = Objective(1.0, 0.0)
FIVE = np.deg2rad(5.0)
SCENARIOS = robots.CONFIG / "scenarios"


def limited(problem: PlanningProblem, angle: float, **limits: float) -> PlanningProblem:
    return replace(problem, limits=Limits(chaser_rotation=angle, **limits))


def rotation_of(problem: PlanningProblem, made: Plan) -> float:
    """Integrated anew: the largest angle between the base and its first attitude."""
    base = Rotation.from_quat(truth(problem, made.trajectory).q[:, 3:7])
    return float((base[0].inv() * base).magnitude().max())


@pytest.fixture(scope="module")
def by_euler(lemur_capture: PlanningProblem) -> Plan:
    """The plan whose Euler angles stay within 5 deg."""
    asked = replace(lemur_capture, objective=LENGTH, limits=Limits(chaser_attitude=FIVE))
    return perform(PlanningTask(asked, SETTINGS))


def test_euler_angles_within_a_limit_allow_a_rotation_beyond_it(
    lemur_capture: PlanningProblem, by_euler: Plan
) -> None:
    assert by_euler.metrics.max_chaser_euler <= FIVE
    assert by_euler.metrics.max_chaser_rotation > 1.3 * FIVE
    turned = rotation_of(lemur_capture, by_euler)
    assert by_euler.metrics.max_chaser_rotation == pytest.approx(turned, abs=1e-5)
    (failure,) = failures(limited(lemur_capture, FIVE), by_euler, SETTINGS)
    assert failure.status is Status.LIMIT_VIOLATED
    beyond = f"{turned - FIVE:.3g} rad beyond limits.chaser_rotation of {FIVE:g} rad"
    assert f"the chaser has rotated by {turned:.5g} rad, " in failure.finding
    assert beyond in failure.finding
    assert not list(failures(limited(lemur_capture, turned + 1e-5), by_euler, SETTINGS))


@pytest.mark.parametrize("points", [50, 13])
def test_a_plan_keeps_the_rotation_that_its_euler_angles_would_exceed(
    lemur_capture: PlanningProblem, lemur_plan: Plan, points: int
) -> None:
    """Between its points, too; the limit is used, and costs joint path."""
    asked = replace(limited(lemur_capture, FIVE), objective=LENGTH, points=points)
    found = perform(PlanningTask(asked, SETTINGS))
    assert FIVE - 2e-3 < rotation_of(asked, found) <= FIVE
    assert found.metrics.max_chaser_rotation <= FIVE
    assert found.metrics.max_chaser_euler < FIVE
    assert found.metrics.joint_path_length > lemur_plan.metrics.joint_path_length


def scenario(name: str, **changes: object) -> PlanningProblem:
    found = load_scenario(SCENARIOS / f"{name}.yaml")
    return replace(found, objective=LENGTH, **changes)  # type: ignore[arg-type]


def free_moment() -> PlanningProblem:
    found = scenario("lemur_capture")
    weights = Objective(1.0, 0.0, 0.05)
    return replace(found, objective=weights, duration_range=DurationRange(8.0, 10.0))


PROBLEMS: dict[str, Callable[[], PlanningProblem]] = {
    "bodies": lambda: scenario("lemur_capture_bodies"),
    "a tumbling target": lambda: scenario("lemur_tumbling"),
    "a table": lambda: scenario("planar_capture"),
    "joint splines": lambda: scenario(
        "lemur_capture", parametrisation=Parametrisation.JOINT_SPLINE
    ),
    "another arm": lambda: scenario("canadarm2_capture"),
    "a duration to choose": free_moment,
}


@pytest.mark.sampled
@pytest.mark.law("PLAN-11")
@pytest.mark.parametrize("name", PROBLEMS)
def test_whatever_is_planned_keeps_it_at_all_times(name: str) -> None:
    problem = PROBLEMS[name]()
    free = perform(PlanningTask(problem, SETTINGS))
    limit = 0.9 * free.metrics.max_chaser_rotation
    asked = replace(problem, limits=replace(problem.limits, chaser_rotation=limit))
    found = perform(PlanningTask(asked, SETTINGS))
    assert rotation_of(asked, found) <= limit + 1e-6
    assert found.metrics.max_chaser_rotation <= limit + 1e-6


def test_a_limit_that_is_far_away_changes_nothing(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    for limit in (1.5, 3.0, 4.0):
        found = plan(limited(lemur_capture, limit), SETTINGS)
        assert found.coefficients.tobytes() == lemur_plan.coefficients.tobytes()


@pytest.mark.parametrize("limit", [np.pi, 3.2, 100.0])
def test_no_rotation_is_more_than_half_a_turn(
    lemur_capture: PlanningProblem, lemur_plan: Plan, limit: float
) -> None:
    """What limits to that much is no limit, and the search need not know of it."""
    asked, required = limited(lemur_capture, limit), ChaserRotation()
    program = path_program(asked, end_effector_paths(asked), SETTINGS)
    at_x, motion = program.linearise(np.zeros(18)), program.family.motion(np.zeros(18), 13)
    assert not required.concerns(asked)
    assert rows_of(required, asked, motion, sensitivity_of(program.family, motion), 0.0) is None
    assert required.slack(asked, program.followed(at_x)) == np.inf
    assert not list(failures(asked, lemur_plan, SETTINGS))


def test_a_limit_that_nothing_keeps_is_a_refusal_by_name(lemur_capture: PlanningProblem) -> None:
    """The chaser drifts this far whatever the arm does."""
    asked = replace(limited(lemur_capture, 0.005), points=13)
    with pytest.raises(NoPlanFound) as refusal:
        plan(asked, replace(SETTINGS, starts=2))
    assert any("limits.chaser_rotation" in found.finding for found in refusal.value.failures)


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(0, marks=pytest.mark.ci),
        *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (1, 2)),
    ],
)
def test_the_same_task_in_another_frame_keeps_the_same_angle(
    lemur_capture: PlanningProblem, seed: int
) -> None:
    """Its Euler angles about other axes would be others; a chaser may begin turned by any angle."""
    asked = replace(limited(lemur_capture, 0.15), objective=LENGTH, points=25)
    rng = np.random.default_rng(seed)
    frame = pin.SE3(Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))
    here, there = (
        perform(PlanningTask(problem, SETTINGS)) for problem in (asked, seen_from(asked, frame))
    )
    assert here.metrics.max_chaser_rotation <= 0.15
    assert there.metrics.max_chaser_rotation == pytest.approx(
        here.metrics.max_chaser_rotation, abs=1e-6
    )
    # The check measures since the first point in any frame, too.
    seen = failures(seen_from(limited(asked, 0.1), frame), there, SETTINGS)
    words = [failure.finding for failure in seen if "chaser_rotation" in failure.finding]
    turned = f"the chaser has rotated by {here.metrics.max_chaser_rotation:.5g} rad"
    assert [word.startswith(turned) for word in words] == [True]


@pytest.mark.law("PLAN-11")
@pytest.mark.parametrize("behaviour", [EndBehaviour.HOLD_END_EFFECTOR, EndBehaviour.STOP_JOINTS])
def test_the_tail_keeps_it_or_is_refused(
    lemur_capture: PlanningProblem, lemur_plan: Plan, behaviour: EndBehaviour
) -> None:
    """This chaser rotates on after the goal; the angle up to the goal is allowed."""
    task = PlanningTask(lemur_capture, SETTINGS, end_behaviour=behaviour, tail=3.0)
    whole = perform(task)
    to_goal, in_all = (one.metrics.max_chaser_rotation for one in (lemur_plan, whole))
    assert in_all > to_goal + 0.01
    assert in_all == pytest.approx(rotation_of(lemur_capture, whole), abs=1e-5)
    allowed, refused = (limited(lemur_capture, in_all + a) for a in (1e-4, -1e-3))
    kept = perform(replace(task, problem=allowed))
    assert kept.metrics.max_chaser_rotation <= in_all + 1e-4
    with pytest.raises(NoPlanFound, match=f"{behaviour}.*limits.chaser_rotation") as error:
        perform(replace(task, problem=refused))
    assert error.value.status is Status.LIMIT_VIOLATED


def test_a_plan_that_takes_over_counts_from_its_own_first_point(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """From there on it rotates less than the plan that it takes over from, and keeps that limit."""
    running = joint_motion(lemur_plan.trajectory)
    task = PlanningTask(
        lemur_capture, SETTINGS, ahead=4.0, running=running, running_goal=lemur_capture.duration
    )
    task = replace(task, problem=replace(lemur_capture, duration=6.0))
    free = perform(task)
    angle = free.metrics.max_chaser_rotation
    assert angle < lemur_plan.metrics.max_chaser_rotation - 0.01
    found = perform(replace(task, problem=limited(task.problem, 0.95 * angle)))
    assert found.metrics.max_chaser_rotation <= 0.95 * angle


FAMILIES: dict[str, Callable[[PlanningProblem], Any]] = {
    "paper": end_effector_paths,
    "splines": lambda problem: joint_splines(problem, SETTINGS),
}


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("limit", [0.03, 0.1, 0.2])
def test_rows_have_the_derivatives_of_differences(
    lemur_capture: PlanningProblem, family: str, limit: float
) -> None:
    """Below the knee and beyond it, within the limit and outside."""
    problem = replace(limited(lemur_capture, limit), points=9, obstacles=())
    paths = FAMILIES[family](problem)
    program = path_program(problem, paths, SETTINGS)
    rng, step = np.random.default_rng(0), 1e-6
    x = next(paths.first_guesses((), 9, 0.0)) + rng.normal(scale=0.05, size=paths.variables)

    def rows(x: Array) -> tuple[Array, Array]:
        motion = paths.motion(x, program.points, 0.0)
        found = rows_of(
            ChaserRotation(), problem, motion, sensitivity_of(paths, motion, 0.0), 0.001
        )
        assert found is not None
        assert len(set(found.names)) == len(found.names)
        return found.values, found.jacobian

    values, jacobian = rows(x)
    assert len(values) > 3
    aside = step * np.eye(paths.variables)
    expected = np.stack([(rows(x + a)[0] - rows(x - a)[0]) / (2 * step) for a in aside], axis=1)
    np.testing.assert_allclose(jacobian, expected, rtol=0.0, atol=2e-7)


@pytest.fixture(params=range(20))
def drawn(request: pytest.FixtureRequest) -> tuple[Array, Array, float]:
    """A base at the start and later, its axes anywhere, and a knee."""
    rng = np.random.default_rng(request.param)
    start = Rotation.random(random_state=rng)
    axis = rng.normal(size=3)
    angles = np.concatenate([[0.0, 1e-12, 1e-7], rng.uniform(0.0, 3.1, 30)])
    since = Rotation.from_rotvec(np.outer(angles, axis / np.linalg.norm(axis)))
    # Both quaternions of a rotation stand for it.
    signs = rng.choice([-1.0, 1.0], size=(len(angles), 1))
    q = np.hstack([rng.normal(size=(len(angles), 3)), signs * (start * since).as_quat()])
    return np.concatenate([np.zeros(3), start.as_quat()]), q, float(rng.uniform(0.01, 1.5))


def test_the_measure_is_within_a_limit_where_the_angle_is(
    drawn: tuple[Array, Array, float],
) -> None:
    start, q, knee = drawn
    base = Rotation.from_quat(start[3:7]).inv() * Rotation.from_quat(q[:, 3:7])
    angles = base.magnitude()
    values, _ = huber(start, q, knee)
    beyond = angles >= knee
    np.testing.assert_allclose(values[beyond], angles[beyond], rtol=0.0, atol=1e-12)
    assert (values[~beyond] < knee).all()
    assert (values >= knee / 2.0).all()
    for limit in (1.01 * knee, 2.0 * knee, 3.0):
        if limit > knee:
            assert ((values <= limit) == (angles <= limit)).all()
    np.testing.assert_allclose(angle_of_quaternion(base.as_quat()), angles, rtol=0.0, atol=1e-12)


def test_the_measure_has_its_derivative_at_any_angle_and_at_none(
    drawn: tuple[Array, Array, float],
) -> None:
    start, q, knee = drawn
    _, gradient = huber(start, q, knee)
    assert (gradient[0] == 0.0).all() or np.abs(gradient[0]).max() < 1e-12
    assert (np.linalg.norm(gradient, axis=1) <= 1.0 + 1e-12).all()
    step = 1e-6
    for axis in range(3):
        sides = []
        for way in (step, -step):
            turned = Rotation.from_quat(q[:, 3:7]) * Rotation.from_rotvec(way * np.eye(3)[axis])
            sides.append(huber(start, np.hstack([q[:, :3], turned.as_quat()]), knee)[0])
        expected = (sides[0] - sides[1]) / (2 * step)
        # At the knee the second derivative is another one.
        off = 1e-8 + step / knee
        np.testing.assert_allclose(gradient[:, axis], expected, rtol=0.0, atol=off)


def test_the_measure_is_the_same_in_any_frame_and_of_any_body_axes(
    drawn: tuple[Array, Array, float],
) -> None:
    start, q, knee = drawn
    rng = np.random.default_rng(0)
    frame, axes = Rotation.random(random_state=rng), Rotation.random(random_state=rng)

    def seen(base: Array) -> Array:
        turned = frame * Rotation.from_quat(base[..., 3:7]) * axes
        return np.concatenate([base[..., :3], turned.as_quat()], axis=-1)

    here, gradient = huber(start, q, knee)
    there, turned = huber(seen(start), seen(q), knee)
    np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(axes.inv().apply(gradient), turned, rtol=0.0, atol=1e-9)
