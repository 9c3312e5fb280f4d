"""Plans that take over from one that runs: they begin on it, and near what remains of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from robots import LEMUR_SCENARIO

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.demo.executive import end_effector
from ff_planner_ros.demo.following import miss_by_torques_alone
from ff_planner_ros.demo.testbed import with_heavier_arm
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import REMAINDER, Plan
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Parametrisation,
    PlanningProblem,
    lasting,
    with_capture_target,
)
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.continuing import Remainder, joined
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem

SETTINGS = load_parameters().planner
TURN_ERROR = np.deg2rad(0.01)  # [rad/s]
FAMILIES = [Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE]
AHEAD = 0.2  # from a measurement to the handover [s]


@pytest.fixture(scope="module", params=FAMILIES)
def problem(request: pytest.FixtureRequest) -> PlanningProblem:
    return replace(load_scenario(LEMUR_SCENARIO), parametrisation=request.param)


@pytest.fixture(scope="module")
def running(problem: PlanningProblem) -> Plan:
    return perform(PlanningTask(problem, SETTINGS))


def continuing(
    problem: PlanningProblem, motion: JointMotion, since: float, measured: SystemState
) -> PlanningTask:
    """Return the task that takes over from a motion a little later than a measurement.

    Args:
        since: From the motion's first point to the measurement [s].
    """
    goal = problem.duration - since
    return PlanningTask(
        replace(problem, start=measured, duration=goal - AHEAD),
        SETTINGS,
        ahead=AHEAD,
        running=replace(motion, time=motion.time - since),
        running_goal=goal,
    )


def off(state: SystemState, joints: Array, rate: float) -> SystemState:
    """Return a state with a controller's tracking error, and a chaser that turns otherwise."""
    return replace(
        state,
        joint_positions=state.joint_positions + joints,
        angular_velocity_chaser_in_inertial=state.angular_velocity_chaser_in_inertial + rate,
    )


def first_state(plan: Plan) -> SystemState:
    motion = plan.trajectory
    return SystemState(
        motion.chaser_positions[0],
        motion.chaser_quaternions_xyzw[0],
        motion.chaser_linear_velocities[0],
        motion.chaser_angular_velocities[0],
        motion.joint_positions[0],
        motion.joint_velocities[0],
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joints_that_go_over_to_the_plan_leave_the_momentum_as_it_was_measured(
    problem: PlanningProblem, running: Plan, sign: float
) -> None:
    """About the centre of mass: nothing pushes the system."""
    motion, robot = joint_motion(running.trajectory), problem.robot
    truth = carried_forward(robot, problem.start, 4.0, motion)
    off_by = sign * np.linspace(0.01, 0.07, robot.joints)
    measured = replace(
        truth,
        joint_positions=truth.joint_positions + off_by,
        joint_velocities=truth.joint_velocities - off_by,
    )
    found = joined(robot, measured, 0.0, replace(motion, time=motion.time - 4.0))
    before, after = (
        pin.computeCentroidalMomentum(
            robot.model, robot.model.createData(), *configuration(robot, state)
        ).vector
        for state in (measured, found)
    )
    np.testing.assert_allclose(found.joint_velocities, truth.joint_velocities, atol=1e-9)
    np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-8 * np.abs(before).max())


def test_a_search_that_ends_at_its_first_step_has_the_remainder_of_the_running_plan(
    problem: PlanningProblem, running: Plan
) -> None:
    motion = joint_motion(running.trajectory)
    measured = carried_forward(problem.robot, problem.start, 4.0, motion)
    plan = perform(continuing(problem, motion, 4.0, measured).ended_at(1))
    assert (plan.family, plan.effort) == (REMAINDER, 1)


@pytest.mark.parametrize("point", [3, 30])
def test_what_runs_as_planned_is_joined_where_the_plan_says_that_it_will_be(
    problem: PlanningProblem, running: Plan, point: int
) -> None:
    """From one point of it to the next; the chaser drifts meanwhile."""
    motion, since = running.trajectory, running.trajectory.time[point]
    now, then = (
        SystemState(
            motion.chaser_positions[at],
            motion.chaser_quaternions_xyzw[at],
            motion.chaser_linear_velocities[at],
            motion.chaser_angular_velocities[at],
            motion.joint_positions[at],
            motion.joint_velocities[at],
            motion.joint_accelerations[at],
        )
        for at in (point, point + 1)
    )
    ahead = float(motion.time[point + 1] - since)
    found = joined(problem.robot, now, ahead, joint_motion(motion, -since))
    assert np.linalg.norm(then.position_chaser_in_inertial - now.position_chaser_in_inertial) > 1e-3
    for item in fields(SystemState):
        wanted = getattr(then, item.name)
        if wanted is None:
            assert getattr(found, item.name) is None, item.name
            continue
        np.testing.assert_allclose(getattr(found, item.name), wanted, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("since", [0.7, 4.0, 8.5])
def test_it_begins_on_the_running_plan_with_what_was_measured_of_the_chaser(
    problem: PlanningProblem, running: Plan, since: float
) -> None:
    motion, robot = joint_motion(running.trajectory), problem.robot
    tracking = np.random.default_rng(7).normal(scale=1e-3, size=robot.joints)
    truth = carried_forward(robot, problem.start, since, motion)
    measured = off(truth, tracking, TURN_ERROR)
    task = continuing(problem, motion, since, measured)
    found = perform(task)
    joined = [rows[0] for rows in motion.at(np.array([since + AHEAD]))]
    for name, wanted in zip(("positions", "velocities", "accelerations"), joined, strict=True):
        jump = getattr(found.trajectory, f"joint_{name}")[0] - wanted
        assert np.abs(jump).max() < 1e-12, (name, jump)
    # Nothing pushes the system: its momentum stays that of the measurement, but for the tracking
    # error, which the plan does not have.
    data = robot.model.createData()
    before, after = (
        total_momentum(robot, data, *configuration(robot, state))
        for state in (replace(measured, joint_positions=truth.joint_positions), first_state(found))
    )
    exact = carried_forward(robot, measured, AHEAD, replace(motion, time=motion.time - since))
    assert np.abs(after - before).max() < 0.02 * np.abs(before).max()
    angle = exact.quaternion_chaser_to_inertial_xyzw @ found.trajectory.chaser_quaternions_xyzw[0]
    assert abs(angle) > 1.0 - 1e-12
    assert found.metrics.final_position_error <= SETTINGS.position_tolerance


def test_it_takes_few_iterations_from_what_remains(
    lemur_capture: PlanningProblem, times: Callable[[int, int], int]
) -> None:
    asked_for = [
        (Parametrisation.AUTO, Objective(1.0, 0.0)),
        (Parametrisation.JOINT_SPLINE, Objective(1.0, 0.0)),
        (Parametrisation.AUTO, Objective(0.0, 1.0)),
        (Parametrisation.JOINT_SPLINE, Objective(1.0, 1.0)),
    ]
    for family, objective in asked_for[: times(2, 4)]:
        asked = replace(lemur_capture, objective=objective, parametrisation=family)
        motion = joint_motion(perform(PlanningTask(asked, SETTINGS)).trajectory)
        for since in (1.0, 3.0, 5.0, 9.0):
            truth = carried_forward(asked.robot, asked.start, since, motion)
            found = perform(continuing(asked, motion, since, off(truth, np.zeros(7), TURN_ERROR)))
            assert found.solver.starts == 1, (family, objective, since, found.solver)
            assert found.solver.iterations <= 24, (family, objective, since, found.solver)


def test_a_goal_that_moved_is_reached_with_the_duration_asked_for(
    problem: PlanningProblem, running: Plan
) -> None:
    motion, since = joint_motion(running.trajectory), 3.0
    measured = carried_forward(problem.robot, problem.start, since, motion)
    target = replace(
        problem.target, position=problem.target.position + np.array([0.01, -0.02, 0.01])
    )
    task = continuing(replace(problem, target=target), motion, since, measured)
    longer = replace(task, problem=replace(task.problem, duration=9.0))
    found = perform(longer)
    assert found.trajectory.time[-1] == 9.0
    assert np.linalg.norm(found.trajectory.ee_positions[-1] - target.position) < 1e-3


def test_a_free_moment_is_kept_while_there_is_a_plan_then(
    problem: PlanningProblem, running: Plan
) -> None:
    motion, since = joint_motion(running.trajectory), 2.0
    measured = carried_forward(problem.robot, problem.start, since, motion)
    task = continuing(problem, motion, since, measured)
    remaining = problem.duration - since - AHEAD
    for window, moment in (((5.0, 12.0), remaining), ((9.0, 12.0), 9.0), ((5.0, 7.0), 7.0)):
        free = replace(task.problem, duration=window[1], duration_range=DurationRange(*window))
        found = perform(replace(task, problem=free))
        assert found.duration == pytest.approx(moment, abs=1e-12)


def test_a_body_that_tumbles_is_captured_where_it_is_seen_by_then() -> None:
    problem = load_scenario(LEMUR_SCENARIO.parent / "lemur_tumbling.yaml")
    motion, since = joint_motion(perform(PlanningTask(problem, SETTINGS)).trajectory), 3.0
    measured = carried_forward(problem.robot, problem.start, since, motion)
    body = problem.target_body
    assert body is not None
    seen = replace(body.after(since + AHEAD), position=body.after(since + AHEAD).position + 0.003)
    task = continuing(problem, motion, since, measured)
    found = perform(replace(task, problem=with_capture_target(seen, task.problem)))
    grasp = seen.grasp(found.trajectory.time[-1:])
    assert np.linalg.norm(found.trajectory.ee_positions[-1] - grasp.positions[0]) < 1e-3
    assert found.solver.starts == 1


def flown(problem: PlanningProblem, rate: float) -> tuple[float, int]:
    """Fly a capture whose arm is 5 % heavier and whose chaser's rates are measured wrongly.

    Args:
        rate: Of new plans [Hz]; 0: none.

    Returns:
        How far the end effector is from its goal in the end [m], and how many plans there were.
    """
    heavier = with_heavier_arm(problem.robot, 0.05)
    system = FreeFloatingSystem(heavier, problem.start, 0.0)
    task = PlanningTask(
        replace(problem, start=off(problem.start, np.zeros(7), TURN_ERROR)), SETTINGS
    )
    motion, plans, now = joint_motion(perform(task).trajectory), 1, 0.0
    system.follow(motion)
    while rate and problem.duration - (now + 1.0 / rate) - AHEAD > 0.3:
        now += 1.0 / rate
        measured = off(system.advance(now), np.zeros(7), TURN_ERROR)
        found = perform(continuing(problem, motion, now, measured))
        motion, plans = joint_motion(found.trajectory, now + AHEAD), plans + 1
        system.follow(motion)
    reached = end_effector(problem.robot, system.advance(problem.duration))
    return float(np.linalg.norm(reached.position - problem.target.position)), plans


def test_replanning_reaches_what_open_loop_misses(lemur_capture: PlanningProblem) -> None:
    """Torques alone miss it most; joints that a controller tracks, by what the chaser does."""
    plan = perform(PlanningTask(lemur_capture, SETTINGS))
    torques_alone = miss_by_torques_alone(lemur_capture.robot, plan.trajectory)
    assert torques_alone is not None
    assert torques_alone >= 0.040
    tracked, _ = flown(lemur_capture, 0.0)
    replanned, plans = flown(lemur_capture, 5.0)
    assert plans >= 40
    assert replanned <= 0.005
    assert replanned <= 0.5 * tracked


def test_the_same_task_gives_the_same_plan_and_has_a_digest_of_its_own(
    problem: PlanningProblem, running: Plan, tmp_path: Path
) -> None:
    motion, since = joint_motion(running.trajectory), 5.0
    measured = carried_forward(problem.robot, problem.start, since, motion)
    task = continuing(problem, motion, since, measured)
    file = tmp_path / "scenario.yaml"
    write_scenario(task, file)
    read = load_task(file, Defaults(SETTINGS))
    assert read.digest == task.digest != replace(task, running_goal=None).digest
    plans = [perform(task), perform(read)]
    assert plans[0].coefficients.tolist() == plans[1].coefficients.tolist()
    names = ("joint_positions", "chaser_positions", "ee_quaternions_xyzw")
    for name in names:
        one, other = (getattr(plan.trajectory, name) for plan in plans)
        assert (one == other).all(), name


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("joint", [0, 6])
def test_how_far_a_path_is_from_the_remainder_is_told_to_both_sides(
    lemur_capture: PlanningProblem, lemur_plan: Plan, joint: int, sign: float
) -> None:
    """Of a path that is beside it in one joint, at one time; one that is singular is far off."""
    motion = joint_motion(lemur_plan.trajectory)
    remainder = Remainder(replace(motion, time=motion.time - 4.0), 6.0)
    truth = carried_forward(lemur_capture.robot, lemur_capture.start, 4.0, motion)
    problem = replace(lemur_capture, start=truth, duration=6.0)
    seen: list[Array] = []

    def near(q: Array) -> Array:
        seen.append(q)
        return np.zeros(3)

    def path(_: Array, points: int) -> Any:
        q = seen[-1].copy()
        assert len(q) == points
        q[5, 7 + joint] += 0.3 * sign
        return SimpleNamespace(singular_at=None, q=q)

    family: Any = SimpleNamespace(near=near, motion=path)
    assert remainder.path_near(problem, family).off == pytest.approx(0.3)
    # What is looked at is the whole of what remains.
    ends, _, _ = motion.at(np.array([4.0, 10.0]))
    np.testing.assert_allclose(seen[-1][[0, -1], 7:], ends, atol=1e-9)
    family.motion = lambda *_: SimpleNamespace(singular_at=3, q=seen[-1])
    assert remainder.path_near(problem, family).off == np.inf


@pytest.mark.parametrize(("ahead", "goal"), [(0.2, 0.1), (0.2, 0.2), (0.2, np.nan), (0.2, 50.0)])
def test_a_goal_that_the_running_motion_does_not_have_is_refused(
    problem: PlanningProblem, running: Plan, ahead: float, goal: float
) -> None:
    motion = joint_motion(running.trajectory)
    with pytest.raises(InvalidInput, match="running_goal"):
        PlanningTask(problem, SETTINGS, ahead=ahead, running=motion, running_goal=goal)
    with pytest.raises(InvalidInput, match="running_goal") as refused:
        PlanningTask(problem, SETTINGS, ahead=ahead, running_goal=5.0)
    assert refused.value.status is Status.NO_ACTIVE_PLAN


def test_where_nothing_is_near_the_remainder_it_is_planned_as_ever(
    lemur_capture: PlanningProblem,
) -> None:
    """The goal is elsewhere, with an obstacle where the arm wanted to go."""
    motion = joint_motion(perform(PlanningTask(lemur_capture, SETTINGS)).trajectory)
    measured = carried_forward(lemur_capture.robot, lemur_capture.start, 1.0, motion)
    position = lemur_capture.target.position + np.array([0.0, 0.5, 0.0])
    elsewhere = replace(lemur_capture, target=replace(lemur_capture.target, position=position))
    task = continuing(elsewhere, motion, 1.0, measured)
    with_start = replace(task, running_goal=None)
    answers = []
    for one in (task, with_start):
        try:
            answers.append(perform(one).metrics.final_position_error <= 1e-3)
        except FfPlannerError:
            answers.append(False)
    assert answers[0] or not answers[1]
    assert lasting(elsewhere, None) is elsewhere
