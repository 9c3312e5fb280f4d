"""Joint torques and accelerations as the search keeps them: derivatives, plans, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from dense_motion import joints_between, truth
from judging import require_sound
from numpy.polynomial import Polynomial
from reference_dynamics import joint_torques_by_x
from reference_load_rows import accelerations_at_points, raised_at_peaks
from reference_program import rows_of
from robots import CANADARM2_SCENARIO, ROBOTS, random_state
from shared_plans import planned

from ff_planner_benchmark.problems.witnessed import drawn as witnessed
from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Parametrisation,
    PlanningProblem,
)
from ff_planner_ros.planning.requirements.limits.joint_limits import JointAccelerations
from ff_planner_ros.planning.requirements.limits.loads import Torques
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

SETTINGS = load_parameters().planner
FAMILIES = (Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE)


@pytest.fixture(scope="module")
def canadarm2() -> PlanningProblem:
    return load_scenario(CANADARM2_SCENARIO)


def robot_named(name: str) -> Robot:
    if name == "planar":
        return witnessed("planar", 1).problem.robot
    return robot_from_urdf_text(*ROBOTS[name])


def torques_of(robot: Robot, q: Array, v: Array, joint_accelerations: Array) -> Array:
    """Return the joints' part of M a + h where the base's part, but for the table's, is zero."""
    model, data, rows = robot.model, robot.model.createData(), robot.base.rows
    mass, bias = pin.crba(model, data, q), pin.rnea(model, data, q, v, np.zeros(model.nv))
    a = np.concatenate([np.zeros(6), joint_accelerations])
    a[rows] = np.linalg.solve(mass[np.ix_(rows, rows)], -(bias + mass @ a)[rows])
    forces = pin.rnea(model, data, q, v, a)
    assert np.abs(forces[rows]).max() < 1e-10 * max(1.0, np.abs(forces).max())
    return np.asarray(forces[6:], np.float64)


@pytest.mark.parametrize("degree", range(6))
def test_accelerations_are_exact_for_quintics_at_every_point(degree: int) -> None:
    time, step = np.linspace(-0.3, 1.5, 7), 0.3
    motion = Polynomial([0.7, -0.2, 0.5, 1.1, -0.9, 0.4][: degree + 1])
    found = accelerations_at_points(motion(time), motion.deriv()(time), step)
    np.testing.assert_allclose(found, motion.deriv(2)(time), rtol=0.0, atol=1e-11)


def test_the_error_of_accelerations_falls_with_the_fourth_power_of_the_step() -> None:
    errors = []
    for points in (21, 41):
        time = np.linspace(0.0, 2.0, points)
        found = accelerations_at_points(np.sin(time), np.cos(time), time[1])
        errors.append(np.abs(found + np.sin(time)).max())
    assert errors[1] < errors[0] / 12.0 < 1e-5, errors


@pytest.mark.parametrize("name", [*ROBOTS, "planar"])
def test_derivatives_of_torques_are_those_of_differences_while_nothing_pushes_the_base(
    name: str,
) -> None:
    robot, rng, step = robot_named(name), np.random.default_rng(5), 1e-6
    model, size = robot.model, 6 + robot.joints
    moved = [*robot.base.rows, *range(6, size)]
    for _ in range(3):
        q, v = configuration(robot, random_state(robot, rng))
        accelerated = rng.normal(size=robot.joints)
        of_q, of_v = np.zeros((2, size, 4))
        of_q[moved], of_v[moved] = rng.normal(size=(2, len(moved), 4))
        of_acceleration = rng.normal(size=(robot.joints, 4))
        (found,) = joint_torques_by_x(
            robot, *(rows[None] for rows in (q, v, accelerated, of_q, of_v, of_acceleration))
        )
        for k in range(4):
            before, after = (
                torques_of(
                    robot,
                    pin.integrate(model, q, side * of_q[:, k]),
                    v + side * of_v[:, k],
                    accelerated + side * of_acceleration[:, k],
                )
                for side in (-step, step)
            )
            expected = (after - before) / (2.0 * step)
            scale = np.abs(expected).max()
            np.testing.assert_allclose(found[:, k], expected, rtol=0.0, atol=1e-7 * scale)


def torques_along(robot: Robot, family: PathFamily, x: Array, points: int) -> Array:
    """Return the torques that the motion's own accelerations need. Shape (points, joints)."""
    motion = family.motion(x, points)
    accelerated = sensitivity_of(family, motion).acceleration[:, 6:]
    samples = zip(motion.q, motion.v, accelerated, strict=True)
    return np.array([torques_of(robot, *sample) for sample in samples])


def drawn(problem: PlanningProblem, which: Parametrisation) -> tuple[PathFamily, Array]:
    family = path_families(replace(problem, parametrisation=which), SETTINGS)[0][0]
    guess = next(iter(family.first_guesses((), 13, 0.0)))
    spread = 0.1 * family.stride
    return family, guess + np.random.default_rng(1).normal(scale=spread, size=len(guess))


@pytest.mark.parametrize("turning_point", np.linspace(0.3, 0.7, 9))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_no_parabola_rises_above_the_values_that_are_raised_at_its_peak(
    lemur_capture: PlanningProblem, turning_point: float, side: float
) -> None:
    problem, curvature = replace(lemur_capture, points=11), 3.0
    time, dense = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 10_001)

    def parabola(at: Array) -> Array:
        return side * (2.0 - curvature * (at - turning_point) ** 2)

    by_x = np.stack([side - 0.0 * time, -side * (time - turning_point) ** 2], axis=1)[:, None]
    values, jacobian = raised_at_peaks(problem, parabola(time)[:, None], by_x)
    peak, raised = np.abs(parabola(dense)).max(), np.abs(values).max()
    rise = curvature * 0.1**2 / 4
    assert peak - 1e-12 <= raised <= peak + rise
    # Raised by as much everywhere, which depends on the curvature alone.
    np.testing.assert_allclose(values[1:-1, 0], parabola(time[1:-1]) + side * rise, atol=1e-12)
    np.testing.assert_allclose(jacobian[1:-1, 0, 0], side, atol=1e-12)
    np.testing.assert_allclose(
        jacobian[1:-1, 0, 1], by_x[1:-1, 0, 1] + side * rise / curvature, atol=1e-12
    )
    # Towards zero, and on fewer points than the plan's, nothing is raised.
    for other, given in ((problem, -4.0 * side), (lemur_capture, 0.0)):
        same, _ = raised_at_peaks(other, (parabola(time) + given)[:, None], by_x)
        np.testing.assert_array_equal(same[:, 0], parabola(time) + given)


@pytest.mark.parametrize("which", FAMILIES)
@pytest.mark.parametrize(
    ("requirement", "points"),
    [(Torques(), 50), (JointAccelerations(), 50), (JointAccelerations(), 25)],
)
def test_rows_of_both_families_have_the_derivatives_of_differences(
    lemur_capture: PlanningProblem, which: Parametrisation, requirement: Requirement, points: int
) -> None:
    lemur_capture = replace(lemur_capture, points=points)
    family, x = drawn(lemur_capture, which)
    most = np.abs(torques_along(lemur_capture.robot, family, x, 25)).max(axis=0)
    robot = replace(lemur_capture.robot, effort_limits=frozen(0.8 * most))
    problem = replace(lemur_capture, robot=robot, limits=Limits(joint_accelerations=(0.05,)))
    way, step = np.random.default_rng(2).normal(size=len(x)), 1e-5

    def rows(along: float) -> tuple[Array, Array]:
        motion = family.motion(x + along * way, 25)
        found = rows_of(requirement, problem, motion, sensitivity_of(family, motion), 0.01)
        assert found is not None
        return found.values, found.jacobian @ way

    (before, _), (_, exact), (after, _) = (rows(along) for along in (-step, 0.0, step))
    assert len(before) == len(exact) == len(after) > 10
    expected = (after - before) / (2.0 * step)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(exact, expected, rtol=0.0, atol=1e-6 * scale)


@pytest.mark.parametrize("which", FAMILIES)
def test_rows_are_what_the_motion_leaves_of_the_limits(
    lemur_capture: PlanningProblem, which: Parametrisation
) -> None:
    """By the motion's own accelerations and RNEA, all of interest but those of the start."""
    family, x = drawn(lemur_capture, which)
    torques = torques_along(lemur_capture.robot, family, x, 49)
    limits = 0.8 * np.abs(torques).max(axis=0)
    robot = replace(lemur_capture.robot, effort_limits=frozen(limits))
    left = 1.0 - np.concatenate([torques[1:], -torques[1:]]) / limits
    motion = family.motion(x, 49)
    problem = replace(lemur_capture, robot=robot)
    found = rows_of(Torques(), problem, motion, sensitivity_of(family, motion), 0.0)
    assert found is not None
    expected = np.sort(left[left < 0.4])
    assert expected.size > 20
    np.testing.assert_allclose(np.sort(found.values), expected, rtol=0.0, atol=2e-3)


@pytest.mark.parametrize("effort", [1e6, np.inf])
def test_limits_that_are_far_change_no_bit_of_a_plan(
    lemur_capture: PlanningProblem, lemur_plan: Plan, effort: float
) -> None:
    robot = replace(lemur_capture.robot, effort_limits=frozen(np.full(7, effort)))
    found = plan(replace(lemur_capture, robot=robot), SETTINGS)
    np.testing.assert_array_equal(found.coefficients, lemur_plan.coefficients)


@pytest.mark.law("PLAN-06")
@pytest.mark.parametrize("which", FAMILIES)
def test_torques_are_brought_below_limits_that_the_shortest_path_exceeds(
    lemur_capture: PlanningProblem, lemur_plan: Plan, which: Parametrisation
) -> None:
    peaks = np.array(lemur_plan.metrics.peak_joint_torques)
    limits = np.full(7, 2.0 * peaks.max())
    limits[peaks.argmax()] = 0.9 * peaks.max()
    robot = replace(lemur_capture.robot, effort_limits=frozen(limits))
    problem = replace(lemur_capture, robot=robot, parametrisation=which)
    found = planned(problem, SETTINGS)
    require_sound(problem, found, SETTINGS)
    assert (truth(problem, found.trajectory).torques <= 1.001 * limits).all()
    if which is Parametrisation.END_EFFECTOR_POLYNOMIAL:
        assert found.solver.starts == 1
        assert found.metrics.joint_path_length < 1.2 * lemur_plan.metrics.joint_path_length


def highest_accelerations(found: Plan) -> Array:
    _, _, _, accelerations = joints_between(found.trajectory, 40)
    highest: Array = np.abs(accelerations).max(axis=0)
    return highest


@pytest.mark.parametrize("points", [50, 9])
@pytest.mark.parametrize("which", FAMILIES)
def test_accelerations_stay_within_their_limits_at_any_time(
    lemur_capture: PlanningProblem, lemur_plan: Plan, which: Parametrisation, points: int
) -> None:
    free = highest_accelerations(lemur_plan)
    limit = 0.8 * free.max()
    problem = replace(
        lemur_capture,
        points=points,
        limits=Limits(joint_accelerations=(limit,)),
        parametrisation=which,
    )
    found = plan(problem, SETTINGS)
    require_sound(problem, found, SETTINGS)
    highest = highest_accelerations(found)
    assert highest.max() <= 1.0001 * limit, highest / limit
    assert found.solver.starts == 1


@pytest.mark.parametrize("limited", ["accelerations", "torques"])
def test_a_start_with_a_joint_at_its_limit_is_planned_from(
    lemur_capture: PlanningProblem, lemur_plan: Plan, limited: str
) -> None:
    start = replace(lemur_capture.start, joint_accelerations=0.05 * (-1.0) ** np.arange(7))
    problem, robot = replace(lemur_capture, start=start), lemur_capture.robot
    if limited == "torques":
        sample = *configuration(robot, start), start.joint_accelerations
        (needed,) = np.abs(joint_torques(robot, *(one[None] for one in sample)))
        limits = 1.5 * np.array(lemur_plan.metrics.peak_joint_torques)
        joint = int((needed / limits).argmax())
        limits[joint], others = needed[joint], np.arange(7) != joint
        limits[others] = np.maximum(limits, 2.0 * needed)[others]
        problem = replace(problem, robot=replace(robot, effort_limits=frozen(limits)))
    else:
        problem = replace(problem, limits=Limits(joint_accelerations=(0.05 / 1.00009,)))
    found = plan(problem, SETTINGS)
    require_sound(problem, found, SETTINGS)


def test_the_check_names_joint_time_and_value_of_an_acceleration_that_is_too_high(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    time, _, _, accelerations = joints_between(lemur_plan.trajectory, 40)
    step, joint = np.unravel_index(np.abs(accelerations).argmax(), accelerations.shape)
    limit = 0.9 * abs(accelerations[step, joint])
    problem = replace(lemur_capture, limits=Limits(joint_accelerations=(limit,)))
    with pytest.raises(NoPlanFound) as refusal:
        require_sound(problem, lemur_plan, SETTINGS)
    assert refusal.value.status is Status.LIMIT_VIOLATED
    for words in (
        f"joint {lemur_plan.joint_names[joint]} accelerates by {accelerations[step, joint]:.3g}",
        f"beyond its limit of {limit:g} rad/s2, at t = {time[step]:.1f}",
    ):
        assert words in str(refusal.value), (words, str(refusal.value))


def test_a_limit_that_no_path_keeps_is_told_by_the_joint(lemur_capture: PlanningProblem) -> None:
    problem = replace(lemur_capture, limits=Limits(joint_accelerations=(1e-3,)))
    few = replace(SETTINGS, starts=1)
    problem = replace(problem, parametrisation=Parametrisation.JOINT_SPLINE)
    with pytest.raises(NoPlanFound, match=r"joint \w+ accelerates by"):
        plan(problem, few)


def test_a_start_that_accelerates_too_much_is_refused_by_name(
    lemur_capture: PlanningProblem,
) -> None:
    start = replace(lemur_capture.start, joint_accelerations=np.array([0.0, -0.2, *[0.0] * 5]))
    limits = Limits(joint_accelerations=(1.0, 0.1, *[1.0] * 5))
    with pytest.raises(InvalidInput) as refusal:
        plan(replace(lemur_capture, start=start, limits=limits), SETTINGS)
    assert refusal.value.status is Status.START_OUTSIDE_LIMITS
    assert refusal.value.field == f"joints.acceleration[{lemur_capture.robot.joint_names[1]}]"


@pytest.mark.parametrize("limits", [(0.0,), (0.1, -1.0), (np.inf,), (0.1,) * 6, ()])
def test_accelerations_that_are_no_limits_are_refused(
    lemur_capture: PlanningProblem, limits: tuple[float, ...]
) -> None:
    with pytest.raises(InvalidInput, match=r"limits\.acceleration"):
        replace(lemur_capture, limits=Limits(joint_accelerations=limits))


def test_one_limit_for_all_joints_is_the_same_task_as_one_for_each_and_none_is_another(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    def task(limits: tuple[float, ...] | None) -> PlanningTask:
        return PlanningTask(
            replace(lemur_capture, limits=Limits(joint_accelerations=limits)), SETTINGS
        )

    digests = [task(limits).digest for limits in (None, (0.2,), (0.2,) * 7, (0.3,))]
    assert digests[0] == PlanningTask(replace(lemur_capture, limits=Limits()), SETTINGS).digest
    assert digests[1] == digests[2]
    assert len(set(digests)) == 3
    write_scenario(task((0.2,)), tmp_path / "saved.yaml")
    assert (
        load_task(tmp_path / "saved.yaml", Defaults(SETTINGS)).problem.limits.joint_accelerations
        == (0.2,) * 7
    )


def test_a_capture_in_haste_keeps_the_effort_limits(canadarm2: PlanningProblem) -> None:
    """Whose least joint path needs 14 % more torque than there is."""
    problem = replace(canadarm2, duration=14.0, limits=Limits())
    found = plan(problem, SETTINGS)
    require_sound(problem, found, SETTINGS)
    assert (truth(problem, found.trajectory).torques <= 1.001 * 2332.0).all()


def test_the_fastest_capture_is_as_fast_as_torques_allow(canadarm2: PlanningProblem) -> None:
    window = DurationRange(5.0, 15.0)
    problem = replace(
        canadarm2,
        obstacles=(),
        limits=Limits(),
        duration=15.0,
        duration_range=window,
        objective=Objective(0.0, 0.0, 1.0),
        parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL,
    )
    found = plan(problem, replace(SETTINGS, starts=2))
    assert found.duration is not None
    assert window.minimum < found.duration < 14.0
    assert 0.97 * 2332.0 < max(found.metrics.peak_joint_torques) <= 2332.0 + 1e-6


def test_torques_are_nobodys_matter_where_effort_limits_are_not_to_be_kept(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    most = np.array(lemur_plan.metrics.peak_joint_torques)
    robot = replace(lemur_capture.robot, effort_limits=frozen(0.01 * most))
    kept = replace(lemur_capture, robot=robot)
    free = replace(kept, limits=Limits(joint_torques=False))
    with pytest.raises(NoPlanFound, match=r"joint_\d needs .* beyond its effort limit") as refused:
        require_sound(kept, lemur_plan, SETTINGS)
    assert refused.value.status is Status.TORQUE_TOO_HIGH
    assert "limits.effort none" in refused.value.failures[0].advice
    found = planned(free, SETTINGS)
    require_sound(free, found, SETTINGS)
    assert found.metrics.joint_path_length == lemur_plan.metrics.joint_path_length
    peaks = np.array(found.metrics.peak_joint_torques)
    assert found.metrics.min_torque_margin == pytest.approx((0.01 * most - peaks).min())
    assert found.metrics.min_torque_margin < 0.0
    tasks = [PlanningTask(one, SETTINGS).digest for one in (kept, free)]
    assert tasks[0] != tasks[1]


def test_effort_limits_are_kept_unless_the_file_says_otherwise(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    file = tmp_path / "capture.yaml"
    for kept in (True, False):
        task = PlanningTask(replace(lemur_capture, limits=Limits(joint_torques=kept)), SETTINGS)
        write_scenario(task, file)
        assert load_scenario(file).limits.joint_torques is kept
    text = file.read_text()
    for word, limits in (("from_urdf", True), ("none", False), ("some", None)):
        file.write_text(text.replace("effort: none", f"effort: {word}"))
        if limits is None:
            with pytest.raises(InvalidInput, match=r"limits\.effort is some: it must be from_urdf"):
                load_scenario(file)
        else:
            assert load_scenario(file).limits.joint_torques is limits
    file.write_text(text.replace("effort: none, ", ""))
    assert load_scenario(file).limits.joint_torques is True
