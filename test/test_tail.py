"""What the arm does after the goal, against formulas written out and an independent engine."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pinocchio as pin
import pytest
from judging import require_sound
from near_bodies import certified_clearance
from scipy.spatial.transform import Rotation
from shared_plans import planned

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import MAX_POINTS, Limits, Obstacle, PlanningProblem
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.tail import EndBehaviour, tail_intervals, with_tail
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
NONE, HOLD, STOP = EndBehaviour
TAILS = pytest.mark.parametrize("behaviour", [HOLD, STOP])


@pytest.fixture(scope="module")
def moving_target(lemur_capture: PlanningProblem) -> PlanningProblem:
    """A target that drifts and tumbles; nothing is in the way."""
    target = replace(
        lemur_capture.target,
        linear_velocity=np.array([0.01, -0.02, 0.015]),
        angular_velocity=np.array([0.02, 0.01, -0.03]),
    )
    return replace(lemur_capture, target=target, obstacles=())


@pytest.fixture(scope="module")
def moving_plan(moving_target: PlanningProblem) -> Plan:
    return planned(moving_target, SETTINGS)


def after_goal(answer: Plan) -> Array:
    """Times since the goal, the goal itself first."""
    return answer.trajectory.time[49:] - 10.0


def refused_tail(problem: PlanningProblem, sound: Plan, *tail: object) -> NoPlanFound:
    """The refusal of the tail of a plan that is itself sound."""
    answer = replace(sound, metrics=measure(problem, sound.trajectory, SETTINGS))
    require_sound(problem, answer, SETTINGS)
    with pytest.raises(NoPlanFound) as refused:
        with_tail(problem, answer, *tail, SETTINGS)
    return refused.value


def test_with_nothing_after_the_goal_it_is_the_plan_and_its_joints_move_at_the_end(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    assert with_tail(lemur_capture, lemur_plan, NONE, 0.0, SETTINGS) is lemur_plan
    assert np.abs(lemur_plan.trajectory.joint_velocities[-1]).max() > 0.01


@TAILS
def test_up_to_the_goal_nothing_changes_and_the_metrics_of_the_goal_stay(
    lemur_capture: PlanningProblem, lemur_plan: Plan, behaviour: EndBehaviour
) -> None:
    longer = with_tail(lemur_capture, lemur_plan, behaviour, 3.0, SETTINGS)
    for item in fields(lemur_plan.trajectory):
        before = getattr(lemur_plan.trajectory, item.name)
        assert np.array_equal(getattr(longer.trajectory, item.name)[:50], before)
    for name in (
        "joint_path_length",
        "max_chaser_euler",
        "final_position_error",
        "final_orientation_error",
        "start_velocity_jump",
    ):
        assert getattr(longer.metrics, name) == getattr(lemur_plan.metrics, name), name
    assert longer.solver is lemur_plan.solver


@TAILS
@pytest.mark.parametrize(("step", "seconds", "intervals"), [(10 / 49, 20 / 49 * 5, 10), (0, 3, 15)])
def test_its_points_are_equally_far_apart_and_not_further_than_the_plans(
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    behaviour: EndBehaviour,
    step: float,
    seconds: float,
    intervals: int,
) -> None:
    time = with_tail(lemur_capture, lemur_plan, behaviour, seconds, SETTINGS).trajectory.time
    assert len(time) == 50 + intervals
    assert np.diff(time[49:]) == pytest.approx(np.full(intervals, step or 0.2), abs=1e-12)
    assert time[-1] == pytest.approx(10.0 + seconds, abs=1e-12)


def test_a_whole_number_of_the_plans_steps_takes_as_many(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """Whatever rounding makes of the quotient."""
    time = lemur_plan.trajectory.time
    for steps in range(8, 49, 5):
        for seconds in (time[steps], np.nextafter(time[steps], 99.0)):
            longer = with_tail(lemur_capture, lemur_plan, STOP, seconds, SETTINGS)
            assert len(longer.trajectory.time) == 50 + steps


@TAILS
def test_a_short_tail_has_points_enough_to_see_its_peaks(
    lemur_capture: PlanningProblem, lemur_plan: Plan, behaviour: EndBehaviour
) -> None:
    time = with_tail(lemur_capture, lemur_plan, behaviour, 0.2, SETTINGS).trajectory.time
    assert np.diff(time[49:]) == pytest.approx(np.full(8, 0.025), abs=1e-12)


def test_stopping_follows_the_cubic_from_rate_and_acceleration_to_rest(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    longer = with_tail(lemur_capture, lemur_plan, STOP, 4.0, SETTINGS)
    motion, planned = longer.trajectory, lemur_plan.trajectory
    s, T = after_goal(longer)[:, None] / 4.0, 4.0
    rate, acceleration = planned.joint_velocities[-1], planned.joint_accelerations[-1]
    assert np.abs(acceleration).max() > 1e-3
    rates = rate * (1 - 3 * s**2 + 2 * s**3) + acceleration * T * s * (1 - s) ** 2
    accelerations = rate * 6 * (s**2 - s) / T + acceleration * (1 - 4 * s + 3 * s**2)
    way = rate * T * (s - s**3 + s**4 / 2)
    way += acceleration * T**2 * (s**2 / 2 - 2 * s**3 / 3 + s**4 / 4)
    assert motion.joint_velocities[49:] == pytest.approx(rates, abs=1e-14)
    assert motion.joint_accelerations[49:] == pytest.approx(accelerations, abs=1e-13)
    assert motion.joint_positions[49:] == pytest.approx(planned.joint_positions[-1] + way)
    # What joint_trajectory_controller takes for rest.
    assert np.abs(motion.joint_velocities[-1]).max() < np.finfo(np.float32).eps


def test_holding_keeps_the_end_effector_at_its_goal_while_the_chaser_moves_on(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    motion = with_tail(lemur_capture, lemur_plan, HOLD, 10.0, SETTINGS).trajectory
    target = lemur_capture.target
    assert motion.ee_positions[49:] == pytest.approx(np.tile(target.position, (50, 1)), abs=1e-6)
    turns = Rotation.from_quat(target.quaternion_xyzw).inv() * Rotation.from_quat(
        motion.ee_quaternions_xyzw[49:]
    )
    assert turns.magnitude().max() < 1e-6
    assert np.linalg.norm(motion.chaser_positions[-1] - motion.chaser_positions[49]) > 0.05
    assert np.abs(motion.ee_linear_velocities[49:]).max() < 1e-12


def test_holding_a_moving_target_goes_with_it(
    moving_target: PlanningProblem, moving_plan: Plan
) -> None:
    longer = with_tail(moving_target, moving_plan, HOLD, 4.0, SETTINGS)
    off = off_the_target(moving_target, longer)
    assert off["position"].max() < 1e-6
    assert off["orientation"].max() < 1e-6
    gone = np.linalg.norm(longer.trajectory.ee_positions[-1] - longer.trajectory.ee_positions[49])
    assert gone == pytest.approx(4.0 * np.linalg.norm([0.01, -0.02, 0.015]), abs=1e-5)


def off_the_target(problem: PlanningProblem, answer: Plan) -> dict[str, Array]:
    """How far the end effector is from where the target's constant twist brings it."""
    target, time, motion = problem.target, after_goal(answer), answer.trajectory
    positions = target.position + np.outer(time, target.linear_velocity)
    turns = Rotation.from_rotvec(np.outer(time, target.angular_velocity))
    there = turns * Rotation.from_quat(target.quaternion_xyzw)
    turned = there.inv() * Rotation.from_quat(motion.ee_quaternions_xyzw[49:])
    return {
        "position": np.linalg.norm(motion.ee_positions[49:] - positions, axis=1),
        "orientation": turned.magnitude(),
    }


@TAILS
def test_momentum_stays_and_the_centre_of_mass_moves_in_a_straight_line(
    moving_target: PlanningProblem, moving_plan: Plan, behaviour: EndBehaviour
) -> None:
    longer = with_tail(moving_target, moving_plan, behaviour, 4.0, SETTINGS)
    robot = moving_target.robot
    data = robot.model.createData()
    q, v = from_trajectory(robot, longer.trajectory)
    momentum = total_momentum(robot, data, q[0], v[0])
    assert total_momentum(robot, data, q[-1], v[-1]) == pytest.approx(momentum, abs=1e-9)
    centers = np.array([pin.centerOfMass(robot.model, data, sample).copy() for sample in q[49:]])
    drift = np.outer(after_goal(longer), momentum[:3] / pin.computeTotalMass(robot.model))
    assert centers - centers[0] == pytest.approx(drift, abs=1e-6)


@TAILS
def test_its_torques_make_it_come_true_in_an_independent_engine(
    lemur_capture: PlanningProblem, lemur_plan: Plan, behaviour: EndBehaviour
) -> None:
    longer = with_tail(lemur_capture, lemur_plan, behaviour, 3.0, SETTINGS)
    found = verify(lemur_capture.robot, longer.trajectory)
    assert found.passed
    assert found.deviation.final_position_error < 1e-4


@pytest.mark.law("PLAN-17")
def test_an_obstacle_beside_the_goal_is_found_by_the_tail_that_drifts_into_it(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    drifted = with_tail(lemur_capture, lemur_plan, STOP, 8.0, SETTINGS).trajectory
    sphere = Obstacle.sphere("strut", drifted.ee_positions[-1], 0.03)
    problem = replace(lemur_capture, obstacles=(*lemur_capture.obstacles, sphere))
    error = refused_tail(problem, lemur_plan, STOP, 8.0)
    assert error.status is Status.COLLISION
    assert str(error).startswith(
        "the plan reaches its goal, but its post-goal segment (stop_joints, 8 s) is not feasible: "
        "the link from joint_4 to joint_5 is 0.03 m inside obstacle strut at t = 18.00 s, 8.00 s "
        "after the goal. What may help:"
    )
    assert isinstance(error.attempt, Plan)
    assert error.attempt.metrics.min_clearance < -0.02
    assert error.attempt.trajectory.time[-1] == 18.0
    with_tail(problem, lemur_plan, HOLD, 8.0, SETTINGS)


@pytest.mark.law("PLAN-17")
def test_a_joint_limit_in_the_way_of_a_stop_is_found(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    stopped = with_tail(lemur_capture, lemur_plan, STOP, 6.0, SETTINGS).trajectory.joint_positions
    beyond = stopped[:50].min(axis=0) - stopped[50:].min(axis=0)
    joint = int(beyond.argmax())
    assert beyond[joint] > 0.02
    robot, lower = lemur_capture.robot, lemur_capture.robot.lower_position_limits.copy()
    lower[joint] = stopped[:50, joint].min() - 0.5 * beyond[joint]
    problem = replace(lemur_capture, robot=replace(robot, lower_position_limits=lower))
    error = refused_tail(problem, lemur_plan, STOP, 6.0)
    assert error.status is Status.LIMIT_VIOLATED
    words = f"post-goal segment (stop_joints, 6 s) is not feasible: joint joint_{joint + 1} is at "
    assert words in str(error)
    assert f"{0.5 * beyond[joint]:.3g} rad beyond its limit of {lower[joint]:g} rad" in str(error)
    assert "at t = 16.00 s, 6.00 s after the goal" in str(error)


def test_a_rate_limit_that_a_ramp_exceeds_is_found(
    moving_target: PlanningProblem, moving_plan: Plan
) -> None:
    """A joint that still speeds up at the goal goes on to do so at first."""
    motion = moving_plan.trajectory
    limits = np.abs(motion.joint_velocities).max(axis=0) + 1e-4
    robot = replace(moving_target.robot, velocity_limits=limits)
    problem = replace(moving_target, robot=robot, limits=Limits(joint_velocities=True))
    faster = motion.joint_accelerations.copy()
    faster[-1] = 0.1 * np.sign(motion.joint_velocities[-1])
    end = replace(moving_plan, trajectory=replace(motion, joint_accelerations=faster))
    with pytest.raises(NoPlanFound) as refused:
        with_tail(problem, end, STOP, 5.0, SETTINGS)
    assert refused.value.status is Status.LIMIT_VIOLATED
    assert "beyond its limit" in str(refused.value)
    assert "s after the goal" in str(refused.value)


def test_a_stop_that_the_motors_cannot_make_is_found(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    weak = replace(lemur_capture.robot, effort_limits=np.full(7, 5.0))
    problem = replace(lemur_capture, robot=weak)
    error = refused_tail(problem, lemur_plan, STOP, 0.05)
    assert error.status is Status.TORQUE_TOO_HIGH
    assert "segment (stop_joints, 0.05 s)" in str(error)
    with_tail(problem, lemur_plan, STOP, 1.0, SETTINGS)


@pytest.mark.parametrize("threshold", [SETTINGS.singular_value_threshold, 0.0])
def test_holding_until_the_arm_is_stretched_is_found(
    lemur_capture: PlanningProblem, lemur_plan: Plan, threshold: float
) -> None:
    settings = replace(SETTINGS, singular_value_threshold=threshold)
    problem = replace(lemur_capture, obstacles=())
    with pytest.raises(NoPlanFound) as refused:
        with_tail(problem, lemur_plan, HOLD, 90.0, settings)
    assert refused.value.status is Status.SINGULAR
    assert "segment (hold_end_effector, 90 s)" in str(refused.value)
    told = str(refused.value).partition("dynamic singularity at t = ")[2]
    # That is from the first point on: a hold that lasts a little longer is refused, too.
    after_goal = float(told.partition(" s")[0]) - problem.duration
    with pytest.raises(NoPlanFound, match="dynamic singularity"):
        with_tail(problem, lemur_plan, HOLD, 1.03 * after_goal, settings)
    with_tail(problem, lemur_plan, HOLD, 0.9 * after_goal, settings)


@TAILS
def test_few_points_are_few_points_told_and_no_coarser_motion(
    lemur_capture: PlanningProblem, behaviour: EndBehaviour
) -> None:
    """Every eighth point of a plan, and a tail that is told once a second."""
    problem = replace(lemur_capture, obstacles=(), points=81)
    fine = planned(problem, SETTINGS)
    told = Trajectory(**{name: rows[::8] for name, rows in vars(fine.trajectory).items()})
    few = replace(fine, trajectory=told)
    finer, coarse = (
        with_tail(asked, answer, behaviour, 8.0, SETTINGS).trajectory
        for asked, answer in ((problem, fine), (replace(problem, points=11), few))
    )
    assert len(coarse.time) == 19
    shared = np.searchsorted(finer.time, coarse.time - 1e-6)
    for name in ("joint_positions", "chaser_quaternions_xyzw", "ee_positions"):
        there = getattr(finer, name)[shared]
        np.testing.assert_allclose(getattr(coarse, name), there, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("quantity", ["position", "orientation"])
def test_a_hold_that_slips_beyond_the_tolerance_is_found(
    moving_target: PlanningProblem, moving_plan: Plan, quantity: str
) -> None:
    held = with_tail(moving_target, moving_plan, HOLD, 20.0, SETTINGS)
    off = off_the_target(moving_target, held)[quantity]
    assert off[0] < off.max() - 1e-9
    strict = replace(SETTINGS, **{f"{quantity}_tolerance": (off[0] + off.max()) / 2})
    finding = rf"end effector's {quantity} is .* off the target .* s after the goal"
    with pytest.raises(NoPlanFound, match=finding) as refused:
        with_tail(moving_target, moving_plan, HOLD, 20.0, strict)
    assert refused.value.status is Status.CHECK_FAILED


def test_clearance_is_certified_on_steps_of_two_lengths(moving_target: PlanningProblem) -> None:
    """Between points eighty times nearer than the plan's nothing moves eighty times as far."""
    coarse = replace(moving_target, points=11)
    longer = with_tail(coarse, plan(coarse, SETTINGS), STOP, 0.1, SETTINGS)
    robot, motion = coarse.robot, longer.trajectory
    q, v = from_trajectory(robot, motion)
    near_goal = (Obstacle.sphere("probe", motion.ee_positions[-1] + [0.06, 0.0, 0.0], 0.05),)
    parts = [
        certified_clearance(robot, q[part], v[part], motion.time[part], near_goal)
        for part in (slice(11), slice(10, None))
    ]
    found = measure(replace(coarse, obstacles=near_goal), motion, SETTINGS).min_clearance
    assert found == pytest.approx(min(parts), abs=5e-4)
    assert found > 5e-3


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.nan, np.inf, 1e9])
@TAILS
def test_a_length_that_is_none_is_refused_by_name(
    lemur_capture: PlanningProblem, lemur_plan: Plan, behaviour: EndBehaviour, seconds: float
) -> None:
    with pytest.raises(InvalidInput, match="post_goal_duration"):
        with_tail(lemur_capture, lemur_plan, behaviour, seconds, SETTINGS)


def test_a_plan_has_no_more_points_with_its_tail_than_a_plan_may(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """Of 50 points in 10 s: with 9950 more it has as many as it may."""
    assert tail_intervals(50, 10.0, STOP, 9950 * 10.0 / 49, False) == MAX_POINTS - 50
    with pytest.raises(InvalidInput, match="10000 at most") as refused:
        with_tail(lemur_capture, lemur_plan, STOP, 9951 * 10.0 / 49, SETTINGS)
    assert refused.value.field == "post_goal_duration"
