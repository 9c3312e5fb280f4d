"""Plans executed on the true free-floating system, whatever their planner believed of it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import random_state
from shared_plans import planned

from ff_planner_ros.baselines.beliefs import (
    executed,
    fixed_base,
    with_fixed_base,
    with_zero_momentum,
    zero_momentum,
)
from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.campaign.methods import method_of
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem, Posture, Target
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum

SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def free(lemur_capture):
    """The capture with nothing in the way."""
    return replace(lemur_capture, obstacles=())


def momentum_of(problem):
    q, v = configuration(problem.robot, problem.start)
    return total_momentum(problem.robot, problem.robot.model.createData(), q, v)


def test_a_plan_for_the_true_momentum_arrives_and_the_chaser_goes_as_predicted(lemur_capture):
    answer = planned(lemur_capture, SETTINGS)
    motion = executed(lemur_capture, answer, SETTINGS)
    assert motion.metrics.final_position_error < 1e-5
    assert motion.metrics.final_orientation_error < 1e-5
    assert motion.metrics.min_clearance > 0.0
    for name in ("chaser_positions", "chaser_linear_velocities", "chaser_angular_velocities"):
        predicted, found = getattr(answer.trajectory, name), getattr(motion.trajectory, name)
        assert found == pytest.approx(predicted, abs=1e-5)
    assert motion.trajectory.joint_torques == pytest.approx(
        answer.trajectory.joint_torques, abs=1e-4
    )


def test_the_joints_follow_the_plan_exactly(free):
    answer = straight_line(with_fixed_base(free), SETTINGS)
    motion = executed(free, answer, SETTINGS).trajectory
    assert np.array_equal(motion.joint_positions, answer.trajectory.joint_positions)
    assert motion.joint_velocities == pytest.approx(answer.trajectory.joint_velocities, abs=1e-12)
    asked = answer.trajectory.joint_accelerations
    assert motion.joint_accelerations == pytest.approx(asked, abs=1e-12)


def test_momentum_stays_and_the_centre_of_mass_moves_in_a_straight_line(free):
    """The second does not follow from velocities that were made to fit: it tests the motion."""
    motion = executed(free, straight_line(with_fixed_base(free), SETTINGS), SETTINGS).trajectory
    robot, data = free.robot, free.robot.model.createData()
    wanted = momentum_of(free)
    q, v = from_trajectory(robot, motion)
    momenta = np.array([total_momentum(robot, data, *sample) for sample in zip(q, v, strict=True)])
    assert momenta == pytest.approx(np.tile(wanted, (free.points, 1)), abs=1e-10)
    centers = np.array([pin.centerOfMass(robot.model, data, sample).copy() for sample in q])
    drift = np.outer(motion.time, wanted[:3] / pin.computeTotalMass(robot.model))
    assert centers - centers[0] == pytest.approx(drift, abs=1e-6)


def test_the_error_of_the_execution_falls_with_the_fourth_power_of_the_step(free):
    """The joints' motion is the same quintic through points on it: only the step differs."""
    fine = executed_on(free, 401)
    coarse, middle = (np.linalg.norm(executed_on(free, points) - fine) for points in (26, 51))
    assert coarse / middle == pytest.approx(16.0, rel=0.25)


def executed_on(problem, points):
    """Final chaser position where every joint follows one quintic from rest to rest."""
    robot = problem.robot
    at_rest = replace(problem.start, joint_velocities=np.zeros(robot.joints))
    true = replace(problem, points=points, start=at_rest)
    template = straight_line(replace(problem, points=points), SETTINGS)
    s = np.linspace(0.0, 1.0, points)[:, None]
    turn, duration = np.linspace(-0.8, 0.8, robot.joints), problem.duration
    joints = replace(
        template.trajectory,
        joint_positions=at_rest.joint_positions + turn * (10 * s**3 - 15 * s**4 + 6 * s**5),
        joint_velocities=turn * (30 * s**2 - 60 * s**3 + 30 * s**4) / duration,
        joint_accelerations=turn * (60 * s - 180 * s**2 + 120 * s**3) / duration**2,
    )
    return executed(true, replace(template, trajectory=joints), SETTINGS).trajectory.ee_positions[
        -1
    ]


def test_a_fixed_base_plan_arrives_where_the_chaser_is_too_heavy_to_move(lemur_capture):
    heavy = with_fixed_base(lemur_capture)
    answer = plan(heavy, SETTINGS)
    motion = executed(heavy, answer, SETTINGS)
    assert motion.metrics.final_position_error < 1e-5
    assert motion.metrics.final_orientation_error < 1e-5
    assert motion.metrics.min_clearance >= 0.0
    still = lemur_capture.start.position_chaser_in_inertial
    assert np.abs(motion.trajectory.chaser_positions - still).max() < 1e-6
    assert motion.metrics.max_chaser_euler < 1e-5


def test_a_fixed_base_plan_misses_where_the_chaser_moves(lemur_capture):
    motion = fixed_base(lemur_capture, SETTINGS)
    assert motion.metrics.final_position_error > 0.1
    assert motion.metrics.final_orientation_error > np.deg2rad(5.0)
    assert motion.metrics.penalty > 0.0  # it clears every obstacle where the chaser stands still
    assert motion.metrics.momentum_error < 1e-12
    assert motion.solver.stop_reason.startswith("planned for a fixed base, good enough")


def test_a_planner_of_a_fixed_base_sees_the_arm_as_it_is_and_a_chaser_at_rest(free):
    heavy = with_fixed_base(free)
    true, seen = free.start, heavy.start
    assert np.array_equal(seen.joint_positions, true.joint_positions)
    assert seen.position_chaser_in_inertial == pytest.approx(true.position_chaser_in_inertial)
    assert np.array_equal(seen.linear_velocity_chaser_in_inertial, np.zeros(3))
    assert np.array_equal(seen.angular_velocity_chaser_in_inertial, np.zeros(3))
    # What is left out of the joint rates does not move the hand; nothing less is left out.
    q, _ = configuration(free.robot, true)
    jacobian = pin.computeFrameJacobian(
        free.robot.model, free.robot.model.createData(), q, free.robot.tip_frame_id
    )[:, 6:]
    left_out = true.joint_velocities - seen.joint_velocities
    assert np.linalg.norm(left_out) > 1e-4
    assert jacobian @ left_out == pytest.approx(np.zeros(6), abs=1e-6)
    assert left_out @ seen.joint_velocities == pytest.approx(0.0, abs=1e-8)


def test_the_true_robot_is_left_as_light_as_it_was(free):
    mass = free.robot.model.inertias[1].mass
    heavy = with_fixed_base(free)
    assert free.robot.model.inertias[1].mass == mass
    assert heavy.robot.model.inertias[1].mass == pytest.approx(1e6 * mass)
    assert heavy.robot.model.gravity.linear == pytest.approx(np.zeros(3))


def test_a_planner_of_zero_momentum_sees_the_joints_as_they_are_and_no_momentum(robot):
    state = random_state(robot, np.random.default_rng(3))
    target = Target(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    true = PlanningProblem(robot, state, target, 10.0, 50, (), Objective(1.0, 0.0))
    seen = with_zero_momentum(true)
    assert np.linalg.norm(momentum_of(true)) > 1.0
    assert momentum_of(seen) == pytest.approx(np.zeros(6), abs=1e-9)
    assert np.array_equal(seen.start.joint_velocities, state.joint_velocities)
    assert seen.start.position_chaser_in_inertial == pytest.approx(
        state.position_chaser_in_inertial
    )


def test_a_zero_momentum_plan_arrives_where_there_is_no_momentum(lemur_capture):
    motion = zero_momentum(with_zero_momentum(lemur_capture), SETTINGS)
    assert motion.metrics.final_position_error < 1e-5
    assert motion.metrics.final_orientation_error < 1e-5
    assert motion.metrics.min_clearance >= 0.0
    assert motion.solver.stop_reason.startswith("planned for zero momentum, good enough")


def test_a_zero_momentum_plan_misses_a_pure_drift_by_velocity_times_time(free):
    """By Galileo: the same motion, carried along; the miss is v t and the orientation is right."""
    drift = np.array([0.03, -0.02, 0.01])
    still = with_zero_momentum(free)
    start = still.start
    drifting = replace(
        still,
        start=replace(
            start,
            linear_velocity_chaser_in_inertial=start.linear_velocity_chaser_in_inertial + drift,
        ),
    )
    metrics = zero_momentum(drifting, SETTINGS).metrics
    expected = np.linalg.norm(drift) * free.duration
    assert metrics.final_position_error == pytest.approx(expected, abs=1e-5)
    assert metrics.final_orientation_error < 1e-5


def test_a_question_that_the_planner_refuses_is_refused(lemur_capture):
    outside = lemur_capture.robot.upper_position_limits + 0.1
    start = replace(lemur_capture.start, joint_positions=outside)
    for method in (fixed_base, zero_momentum):
        with pytest.raises(InvalidInput, match=r"joints\.position"):
            method(replace(lemur_capture, start=start), SETTINGS)


@pytest.mark.parametrize("method", ["fixed_base", "zero_momentum"])
def test_phases_are_refused_at_once(free, method):
    phases = (Phase(2.0, Posture(at_rest=True)),)
    stop = replace(free, posture=Posture(at_rest=True))
    task = PlanningTask(stop, SETTINGS, then=phases)
    with pytest.raises(InvalidInput, match="with phases it must be optimal, straight") as refused:
        perform(task, method=method_of(method, task))
    assert refused.value.status is Status.UNSUPPORTED
    assert (refused.value.field, refused.value.value) == ("method", method)
    first = replace(task, then=())
    assert perform(first, method=method_of(method, first)).duration == stop.duration
