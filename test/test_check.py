"""The check finds what is wrong with a plan, whatever made it."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from dense_motion import joints_between, truth
from judging import require_sound
from near_bodies import certified_clearance
from shared_plans import planned

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.motion import from_trajectory, to_trajectory
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import Limits, Objective, Obstacle
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.configuration import configuration

CONFIG = share_directory() / "config"
SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def problem():
    capture = load_scenario(CONFIG / "scenarios" / "lemur_capture.yaml")
    return replace(capture, objective=Objective(1.0, 0.0))


@pytest.fixture(scope="module")
def sound(problem):
    return planned(problem, SETTINGS)


def tampered(problem, sound, **arrays):
    """The sound plan with other samples, measured anew."""
    trajectory = replace(sound.trajectory, **arrays)
    return replace(sound, trajectory=trajectory, metrics=measure(problem, trajectory, SETTINGS))


def refusal_of(problem, answer):
    with pytest.raises(NoPlanFound) as refusal:
        require_sound(problem, answer, SETTINGS)
    assert refusal.value.attempt is answer
    return refusal.value


def fixed_base_least_rates(problem):
    """The start with the least joint rates that hold the end effector still on a moving base.

    They are not the paper's, which satisfy Eq. (31): they hold a little null-space motion.
    """
    robot = problem.robot
    data = robot.model.createData()
    q, v = configuration(robot, problem.start)
    pin.computeJointJacobians(robot.model, data, q)
    pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    jacobian = pin.getFrameJacobian(robot.model, data, robot.tip_frame_id, pin.LOCAL)
    rates = np.linalg.pinv(jacobian[:, 6:]) @ -jacobian[:, :6] @ v[:6]
    return replace(problem, start=replace(problem.start, joint_velocities=rates))


@pytest.mark.parametrize(
    ("start", "joint_path", "attitude_deg"),
    [
        pytest.param(lambda problem: problem, 1.2194, 13.08, id="the paper's start"),
        pytest.param(fixed_base_least_rates, 1.2239, 13.12, id="the reference's start"),
    ],
)
def test_the_straight_path_has_the_reference_values(problem, start, joint_path, attitude_deg):
    """Two independent implementations, which differ in the joint rates they start with."""
    asked = start(problem)
    metrics = measure(asked, straight_path(asked), SETTINGS)
    assert metrics.joint_path_length == pytest.approx(joint_path, abs=3e-4)
    assert np.rad2deg(metrics.max_chaser_euler) == pytest.approx(attitude_deg, abs=0.01)
    assert metrics.min_clearance == pytest.approx(-0.1399, abs=1e-3)
    assert metrics.penalty > 0.0


def straight_path(problem):
    """The plan of xi = 0, before anybody checks it; the references know no null-space motion."""
    paths = replace(end_effector_paths(problem), null_space=None)
    motion = paths.motion(np.zeros(18), problem.points)
    time = np.linspace(0.0, problem.duration, problem.points)
    accelerations = sensitivity_of(paths, motion).acceleration
    return to_trajectory(problem.robot, time, motion.q, motion.v, accelerations)


def test_a_sound_plan_passes(problem, sound):
    require_sound(problem, sound, SETTINGS)


@pytest.mark.law("PLAN-03")
def test_momentum_that_changes_on_the_way_is_found(problem, sound):
    velocities = sound.trajectory.chaser_linear_velocities.copy()
    velocities[20] += 1e-6
    error = refusal_of(problem, tampered(problem, sound, chaser_linear_velocities=velocities))
    assert error.status is Status.CHECK_FAILED
    assert "momentum_error" in str(error)


@pytest.mark.law("PLAN-02")
def test_an_end_beside_the_target_is_found(problem, sound):
    positions = sound.trajectory.chaser_positions.copy()
    positions[-1] += [0.0, 0.0, 0.002]
    answer = tampered(problem, sound, chaser_positions=positions)
    # Moving the chaser changes its angular momentum too; that is checked elsewhere.
    assert answer.metrics.final_position_error == pytest.approx(0.002, rel=1e-3)
    error = refusal_of(problem, answer)
    assert error.status is Status.CHECK_FAILED
    assert "final_position_error is 0.002 m, allowed is 0.001 m" in str(error)


@pytest.mark.law("PLAN-02")
def test_an_end_that_is_turned_is_found(problem, sound):
    quaternions = sound.trajectory.chaser_quaternions_xyzw.copy()
    turn = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, 0.01])))
    quaternions[-1] = (turn * pin.Quaternion(quaternions[-1])).coeffs()
    answer = tampered(problem, sound, chaser_quaternions_xyzw=quaternions)
    assert answer.metrics.final_orientation_error == pytest.approx(0.01, rel=1e-3)


@pytest.mark.law("PLAN-28")
def test_a_joint_beyond_its_limit_is_found_by_name_time_and_amount(problem, sound):
    times, joints, _, _ = joints_between(sound.trajectory, 1000)
    upper = problem.robot.upper_position_limits.copy()
    upper[3] = joints[:, 3].max() - 0.05
    tight = replace(problem, robot=replace(problem.robot, upper_position_limits=upper))
    answer = replace(sound, metrics=measure(tight, sound.trajectory, SETTINGS))
    error = refusal_of(tight, answer)
    assert error.status is Status.LIMIT_VIOLATED
    time = times[joints[:, 3].argmax()]
    assert f"joint joint_4 is at {joints[:, 3].max():.5g} rad" in str(error)
    assert f"0.05 rad beyond its limit of {upper[3]:g} rad" in str(error)
    assert f"at t = {time:.2f} s" in str(error)


@pytest.mark.parametrize("others", [0.5, np.inf])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_beyond_its_velocity_limit_is_found_by_name_time_and_amount(
    problem, sound, sign, others
):
    times, _, rates, _ = joints_between(sound.trajectory, 1000)
    rates = sign * rates
    time, joint = np.unravel_index(rates.argmax(), rates.shape)
    limits = np.full(7, others)
    limits[joint] = rates[time, joint] - 0.03
    slow = replace(problem, robot=replace(problem.robot, velocity_limits=limits))
    answer = replace(sound, metrics=measure(slow, sound.trajectory, SETTINGS))
    assert answer.metrics.min_velocity_margin == pytest.approx(-0.03, abs=1e-8)
    require_sound(slow, answer, SETTINGS)  # nobody asked to keep the rates
    error = refusal_of(replace(slow, limits=Limits(joint_velocities=True)), answer)
    assert error.status is Status.LIMIT_VIOLATED
    turning = f"joint joint_{joint + 1} moves at {sign * rates[time, joint]:.5g} rad/s"
    assert f"{turning}, 0.03 rad/s beyond its limit of {limits[joint]:g}" in str(error)
    assert f"at t = {times[time]:.2f} s of 10 s" in str(error)
    assert "What may help: a longer duration" in str(error)


def test_a_rate_beyond_its_limit_by_what_is_allowed_is_not_refused(problem, sound):
    _, _, rates, _ = joints_between(sound.trajectory, 1000)
    fastest = np.abs(rates).max(axis=0)
    for beyond, refused in ((0.9e-4, False), (1.1e-4, True)):
        robot = replace(problem.robot, velocity_limits=fastest / (1.0 + beyond))
        slow = replace(problem, robot=robot, limits=Limits(joint_velocities=True))
        answer = replace(sound, metrics=measure(slow, sound.trajectory, SETTINGS))
        if refused:
            assert refusal_of(slow, answer).status is Status.LIMIT_VIOLATED
        else:
            require_sound(slow, answer, SETTINGS)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_torque_beyond_its_effort_limit_is_found_by_name_time_and_amount(problem, sound, sign):
    peaks = truth(problem, sound.trajectory).torques
    at_points = sound.trajectory.joint_torques
    points = np.abs(at_points).argmax(axis=0)
    signs = np.sign(at_points[points, range(7)])
    joint = (sign * signs * peaks).argmax()
    assert sign * signs[joint] > 0.0
    limits = np.full(7, np.inf)  # none known
    limits[joint] = peaks[joint] - 0.05
    weak = replace(problem, robot=replace(problem.robot, effort_limits=limits))
    answer = replace(sound, metrics=measure(weak, sound.trajectory, SETTINGS))
    # As exact as the check says that it looks between the points.
    assert answer.metrics.peak_joint_torques == pytest.approx(peaks, rel=5e-4)
    error = refusal_of(weak, answer)
    assert error.status is Status.TORQUE_TOO_HIGH
    told = re.search(
        rf"joint joint_{joint + 1} needs (\S+) N m, (\S+) N m beyond its effort limit of "
        rf"{limits[joint]:g} N m, at t = (\S+) s of 10 s",
        str(error),
    )
    assert told, error
    needed, more, time = map(float, told.groups())
    assert needed == pytest.approx(sign * peaks[joint], rel=1e-3)
    assert more == pytest.approx(0.05, rel=1e-2)
    assert abs(time - sound.trajectory.time[points[joint]]) < 0.2
    assert "What may help: a longer duration" in str(error)


def test_torques_are_judged_by_the_motion_and_not_by_what_the_plan_says(problem, sound):
    limits = np.abs(sound.trajectory.joint_torques).max(axis=0) / 2.0
    weak = replace(problem, robot=replace(problem.robot, effort_limits=limits))
    answer = tampered(weak, sound, joint_torques=np.zeros((50, 7)))
    error = refusal_of(weak, answer)
    assert error.status is Status.TORQUE_TOO_HIGH
    assert "torque_error is" in str(error)


def test_torques_that_do_not_make_the_motion_are_found(problem, sound):
    torques = sound.trajectory.joint_torques.copy()
    torques[20, 3] += 0.01
    answer = tampered(problem, sound, joint_torques=torques)
    assert answer.metrics.torque_error == pytest.approx(0.01, rel=1e-9)
    error = refusal_of(problem, answer)
    assert error.status is Status.CHECK_FAILED
    assert "torque_error is 0.01 N m, allowed is 1e-06 N m" in str(error)


def test_a_robot_whose_effort_limits_are_not_known_may_need_any_torque(problem, sound):
    strong = replace(problem, robot=replace(problem.robot, effort_limits=np.full(7, np.inf)))
    require_sound(strong, sound, SETTINGS)


def test_an_obstacle_in_the_way_is_found_by_name_link_and_depth(problem, sound):
    place = sound.trajectory.ee_positions[25]
    blocked = replace(problem, obstacles=(Obstacle.sphere("bolt", place, 0.05),))
    answer = replace(sound, metrics=measure(blocked, sound.trajectory, SETTINGS))
    error = refusal_of(blocked, answer)
    assert error.status is Status.COLLISION
    assert "obstacle bolt" in str(error)
    assert "0.05" in str(error)


@pytest.mark.law("PLAN-07")
def test_a_pin_between_two_points_is_found_though_every_point_is_clear(problem, sound):
    """Smaller than the way between two points: the samples alone would not see it."""
    q, v = from_trajectory(problem.robot, sound.trajectory)
    tip_a, tip_b = sound.trajectory.ee_positions[24:26]
    pin_head = Obstacle.sphere("pin", (tip_a + tip_b) / 2, np.linalg.norm(tip_b - tip_a) * 0.3)
    times = sound.trajectory.time
    positions = arm_points(problem.robot, q)
    at_points = clearances(positions, times, segments(positions), [pin_head]).distance.min()
    if at_points <= 0.0:
        pytest.fail("the pin must be clear of the points for this test to say anything")
    assert certified_clearance(problem.robot, q, v, times, [pin_head]) < 0.0


@pytest.mark.sampled
@pytest.mark.law("PLAN-09")
@pytest.mark.parametrize("seed", range(8))
def test_the_certified_clearance_is_a_tight_lower_bound(problem, sound, seed):
    """Against a hundred times denser samples of the same cubics, with random spheres."""
    random = np.random.default_rng(seed)
    robot = problem.robot
    q, v = from_trajectory(robot, sound.trajectory)
    step = problem.duration / (problem.points - 1)
    spheres = [
        Obstacle.sphere(
            str(k), random.uniform([0.0, -0.8, 0.0], [2.0, 1.2, 1.8]), random.uniform(0.02, 0.2)
        )
        for k in range(3)
    ]
    # Some rest, some move.
    spheres = [
        s.with_motion(velocity=random.normal(scale=k * 0.1, size=3)) for k, s in enumerate(spheres)
    ]
    certified = certified_clearance(robot, q, v, sound.trajectory.time, spheres)

    dense, times = [], []
    for i in range(len(q) - 1):
        whole = pin.difference(robot.model, q[i], q[i + 1])
        begin, end = step * v[i], step * v[i + 1].copy()
        end[:6] = np.linalg.inv(pin.Jexp6(pin.Motion(whole[:6]))) @ end[:6]
        for s in np.linspace(0.0, 1.0, 101):
            h = [s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2]
            way = h[0] * begin + h[1] * whole + h[2] * end
            dense.append(pin.integrate(robot.model, q[i], way))
            times.append((i + s) * step)
    positions = arm_points(robot, np.array(dense))
    starts = segments(positions)
    truth = min(
        clearances(at[None], np.zeros(1), starts, moved(spheres, time)).distance.min()
        for at, time in zip(positions, times, strict=True)
    )
    assert certified <= truth + 1e-9, (seed, certified, truth)
    assert certified >= truth - 2.1e-4, (seed, certified, truth)


def moved(spheres, time):
    return [s.after(time) for s in spheres]


def test_a_plan_that_is_a_million_times_too_fast_is_refused_and_soon(problem, sound):
    """It turns by thousands of revolutions from point to point, where no step is short enough."""
    wild = tampered(problem, sound, joint_velocities=1e6 * sound.trajectory.joint_velocities)
    found = {one.status for one in refusal_of(problem, wild).failures}
    assert Status.LIMIT_VIOLATED in found


def test_without_obstacles_the_clearance_is_infinite(problem, sound):
    q, v = from_trajectory(problem.robot, sound.trajectory)
    assert certified_clearance(problem.robot, q, v, sound.trajectory.time, []) == np.inf
