"""Each limit of joints and chaser at every place of a plan, both ways: refused by name, or kept."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from handmade_plans import GOAL, PLACES, POINTS, SETTINGS, STEP, Joints, Made, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.problem.problem import Limits
from ff_planner_ros.planning.requirements.limits.joint_limits import JointRates
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

POSTURE = np.array([0.4, -0.7, 0.9, -1.1, 0.6, 0.5])
TWIST, PLACE = np.array([0.02, -0.01, 0.03, 0.04, -0.05, 0.03]), np.array([3.0, -2.0, 1.0])
# Highest rate and acceleration of a quintic from rest to rest, over way / time and way / time^2.
FASTEST, STRONGEST = 15.0 / 8.0, 10.0 / np.sqrt(3.0)
AT_POINTS = {"start": 0, "between": 4, "goal": GOAL, "end": POINTS - 1}
both_ways = pytest.mark.parametrize("sign", [1.0, -1.0])
everywhere = pytest.mark.parametrize("place", PLACES)
at_points = pytest.mark.parametrize("place", AT_POINTS)


@cache
def robot() -> Robot:
    return robot_from_urdf_text(*ROBOTS["six joints"])


@cache
def moving(kind: str, place: str, joint: int, size: float) -> Made:
    """One joint moves at one place alone, while the chaser tumbles."""
    joints = resting(POSTURE)
    if kind == "bulge":
        joints = joints.bulging(joint, PLACES[place], size)
    elif kind == "step":
        joints = joints.stepping(joint, PLACES[place], size)
    else:
        samples: Array = getattr(joints, kind).copy()
        samples[AT_POINTS[place], joint] = size
        joints = Joints(**(vars(joints) | {kind: samples}))
    return made(robot(), joints, TWIST, PLACE)


def with_limit(found: Made, name: str, joint: int, value: float) -> Robot:
    limits = getattr(found.problem.robot, name).copy()
    limits[joint] = value
    return replace(found.problem.robot, **{name: limits})


def the_one(found: list[Failure], status: Status, *words: str) -> None:
    (failure,) = found
    assert failure.status is status
    for word in words:
        assert word in failure.finding, (word, failure.finding)


def words_at(time: float) -> str:
    return f"at t = {time:.2f} s" if time != STEP * GOAL else f"at the goal, t = {time:.2f} s"


def test_what_is_made_by_hand_breaks_nothing() -> None:
    for kind, place in (("bulge", "tail"), ("step", "start"), ("velocities", "goal")):
        assert not moving(kind, place, 2, 0.3).judged()


@pytest.mark.law("PLAN-04")
@everywhere
@both_ways
def test_a_joint_outside_its_limits_between_two_points_is_refused(place: str, sign: float) -> None:
    found, joint, size = moving("bulge", place, 2, sign * 0.3), 2, 0.3
    name = "upper_position_limits" if sign > 0.0 else "lower_position_limits"
    time = STEP * (PLACES[place] + 0.5)
    for beyond in (0.25, 1.2e-4, 0.8e-4, -1e-3):
        limit = POSTURE[joint] + sign * (size - beyond)
        failures = found.judged(robot=with_limit(found, name, joint, limit))
        if beyond < 1e-4:
            assert not failures
            continue
        words = f"{beyond:.3g} rad beyond its limit of {limit:g} rad"
        the_one(failures, Status.LIMIT_VIOLATED, words, words_at(time))


@pytest.mark.law("PLAN-04")
@at_points
@both_ways
def test_a_joint_that_is_furthest_out_at_a_point_is_refused(place: str, sign: float) -> None:
    found = moving("positions", place, 4, POSTURE[4] + sign * 0.2)
    name = "upper_position_limits" if sign > 0.0 else "lower_position_limits"
    for beyond, refused in ((0.1, True), (-1e-3, False)):
        limit = POSTURE[4] + sign * (0.2 - beyond)
        failures = found.judged(robot=with_limit(found, name, 4, limit))
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.LIMIT_VIOLATED, "0.1 rad beyond its limit of ")


@pytest.mark.law("PLAN-05")
@everywhere
@both_ways
def test_a_joint_that_is_too_fast_between_two_points_is_refused(place: str, sign: float) -> None:
    found, rate = moving("step", place, 1, sign * 0.2), FASTEST * 0.2 / STEP
    time = STEP * (PLACES[place] + 0.5)
    for part, refused in ((0.8, True), (1.0 - 1.2e-4, True), (1.0 - 0.8e-4, False), (1.01, False)):
        slow = with_limit(found, "velocity_limits", 1, part * rate)
        assert not found.judged(robot=slow), "nobody asked to keep it"
        failures = found.judged(robot=slow, limits=Limits(joint_velocities=True))
        assert bool(failures) is refused
        if refused:
            words = f"joint joint_2 moves at {sign * rate:.5g} rad/s, {(1 - part) * rate:.3g} rad/s"
            the_one(failures, Status.LIMIT_VIOLATED, words, words_at(time))


@both_ways
@pytest.mark.parametrize(("rate", "spare"), [(0.3, 3e-5), (1e-3, 1e-6), (0.01, 1e-6)])
def test_start_search_and_check_allow_a_velocity_the_same_excess(
    rate: float, spare: float, sign: float
) -> None:
    """A ten-thousandth of the limit, or where that is less than rounding, 1e-6 rad/s."""
    found = moving("velocities", "start", 1, sign * rate)
    for part, refused in ((0.9, False), (1.1, True)):
        slow = with_limit(found, "velocity_limits", 1, rate - part * spare)
        limits = Limits(joint_velocities=True)
        assert bool(found.judged(robot=slow, limits=limits)) is refused
        problem = replace(found.problem, robot=slow, limits=limits)
        motion = Samples(problem, SETTINGS, found.plan.trajectory).followed
        assert (JointRates().slack(problem, motion) < 0.0) is refused
        q_start, _ = configuration(slow, problem.start)
        with pytest.raises(InvalidInput) if refused else nullcontext():
            JointRates().refuse_start(problem, q_start, SETTINGS)


@pytest.mark.law("PLAN-05")
@at_points
@both_ways
def test_a_joint_that_is_too_fast_at_a_point_is_refused(place: str, sign: float) -> None:
    found = moving("velocities", place, 3, sign * 0.4)
    time = STEP * AT_POINTS[place]
    for limit, refused in ((0.3, True), (0.401, False)):
        slow = with_limit(found, "velocity_limits", 3, limit)
        failures = found.judged(robot=slow, limits=Limits(joint_velocities=True))
        assert bool(failures) is refused
        if refused:
            words = f"joint joint_4 moves at {sign * 0.4:.5g} rad/s, 0.1 rad/s beyond"
            the_one(failures, Status.LIMIT_VIOLATED, words, words_at(time))


def accelerating(joint: int, limit: float) -> Limits:
    limits = np.full(6, 1e3)
    limits[joint] = limit
    return Limits(joint_accelerations=tuple(limits.tolist()))


@pytest.mark.sampled
@at_points
@both_ways
def test_a_joint_that_accelerates_too_much_at_a_point_is_refused(place: str, sign: float) -> None:
    found = moving("accelerations", place, 0, sign * 0.5)
    time = STEP * AT_POINTS[place]
    for part, refused in ((0.8, True), (1.0 - 1.2e-4, True), (1.0 - 0.8e-4, False), (1.01, False)):
        failures = found.judged(limits=accelerating(0, part * 0.5))
        assert bool(failures) is refused
        if refused:
            words = (
                f"joint joint_1 accelerates by {sign * 0.5:.4g} rad/s2, {(1 - part) / 2:.3g} rad"
            )
            the_one(failures, Status.LIMIT_VIOLATED, words, words_at(time))


@pytest.mark.law("PLAN-06")
@everywhere
def test_a_joint_that_accelerates_too_much_between_two_points_is_refused(place: str) -> None:
    found, highest = moving("step", place, 5, 0.2), STRONGEST * 0.2 / STEP**2
    for part, refused in ((0.9, True), (1.0 - 1.2e-4, True), (1.0 - 0.8e-4, False), (1.01, False)):
        failures = found.judged(limits=accelerating(5, part * highest))
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.LIMIT_VIOLATED, "joint joint_6 accelerates by")


@pytest.mark.sampled
@pytest.mark.law("PLAN-06")
@pytest.mark.parametrize(("kind", "places"), [("accelerations", AT_POINTS), ("step", PLACES)])
@pytest.mark.parametrize("number", range(4))
@both_ways
def test_a_torque_beyond_its_effort_limit_is_refused(
    kind: str, places: dict[str, int], number: int, sign: float
) -> None:
    place, joint = list(places)[number], number % 3
    found = moving(kind, place, joint, sign * 0.4)
    torques = found.torques[:, joint]
    peak = int(np.abs(torques).argmax())
    largest = float(np.abs(torques[peak]))
    assert largest > 0.1, "no torque"
    for part, refused in ((0.98, True), (1.012, False)):
        weak = with_limit(found, "effort_limits", joint, part * largest)
        assert not found.judged(robot=weak, limits=Limits(joint_torques=False))
        failures = found.judged(robot=weak)
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.TORQUE_TOO_HIGH, f"joint joint_{joint + 1} needs")
            told = float(failures[0].finding.split("needs ")[1].split()[0])
            if kind == "accelerations":  # of a step both ends need as much
                assert told == pytest.approx(torques[peak], rel=5e-3)
            when = float(failures[0].finding.split("t = ")[1].split()[0])
            at = int(np.abs(found.time - when).argmin())
            assert abs(torques[at]) == pytest.approx(largest, rel=0.03)


def test_metrics_are_the_least_margins_of_all_joints_at_all_times() -> None:
    """A joint near its lower limit, another too fast, a third that accelerates, in the tail too."""
    found = moving("step", "tail", 1, -0.2)
    lower = with_limit(found, "lower_position_limits", 1, POSTURE[1] - 0.25)
    slow = np.full(6, 50.0)
    slow[1] = FASTEST * 0.2 / STEP + 0.1
    asked = replace(
        found.problem,
        robot=replace(lower, velocity_limits=slow, effort_limits=np.full(6, 1e3)),
        limits=accelerating(1, STRONGEST * 0.2 / STEP**2 + 0.3),
    )
    metrics = replace(found, problem=asked).measured()
    assert metrics.min_joint_margin == pytest.approx(0.05, abs=1e-8)
    assert metrics.min_velocity_margin == pytest.approx(0.1, abs=1e-8)
    assert metrics.min_acceleration_margin == pytest.approx(0.3, abs=1e-8)
    peaks = np.abs(found.torques).max(axis=0)
    np.testing.assert_allclose(
        metrics.peak_joint_torques, peaks, rtol=0.012, atol=1e-3 * peaks.max()
    )
    assert metrics.min_torque_margin == pytest.approx(1e3 - peaks.max(), abs=0.012 * peaks.max())
    assert metrics.joint_path_length == 0.0, "the tail is no part of it"


def euler(found: Made) -> Array:
    """Angles phi, theta, psi of the chaser."""
    axes = Rotation.from_matrix(found.problem.robot.rotation_chaser_to_base)
    turned = Rotation.from_quat(found.q[:, 3:7]) * axes
    return np.asarray(turned.as_euler("ZYX")[:, ::-1])


@cache
def swinging(place: str, joint: int, size: float) -> Made:
    """A system at rest: what its chaser turns, the arm makes it turn."""
    joints = resting(POSTURE).swelling(joint, PLACES[place], size)
    return made(robot(), joints, np.zeros(6), PLACE)


@pytest.mark.sampled
@everywhere
@both_ways
def test_a_chaser_that_turns_too_far_is_refused_wherever_that_is(place: str, sign: float) -> None:
    joint = list(PLACES).index(place) % 3
    found = swinging(place, joint, sign * 1.0)
    angles = np.abs(euler(found)).max(axis=1)
    time = found.time[angles.argmax()]
    assert angles.max() > 0.02
    assert abs(time - STEP * (PLACES[place] + 0.5)) < 0.3
    for aside, refused in ((-0.01, True), (-1e-4, True), (1e-4, False)):
        failures = found.judged(limits=Limits(chaser_attitude=float(angles.max() + aside)))
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.LIMIT_VIOLATED, "beyond limits.chaser_attitude")
            words = failures[0].finding.split()
            angle, told = float(words[words.index("of") + 1]), float(words[words.index("=") + 1])
            assert angle == pytest.approx(angles.max(), abs=1e-4)
            assert told == pytest.approx(time, abs=0.03)


def rotated(found: Made) -> Array:
    """Angle of the chaser's rotation since the first point."""
    base = Rotation.from_quat(found.q[:, 3:7])
    return np.asarray((base[0].inv() * base).magnitude())


@pytest.mark.sampled
@pytest.mark.law("PLAN-11")
@everywhere
@both_ways
def test_a_chaser_that_rotates_too_far_is_refused_though_its_euler_angles_are_allowed(
    place: str, sign: float
) -> None:
    found = swinging(place, list(PLACES).index(place) % 3, sign * 1.0)
    angles, largest = rotated(found), float(np.abs(euler(found)).max())
    furthest, time = float(angles.max()), found.time[angles.argmax()]
    assert furthest > largest + 1e-3
    assert found.measured().max_chaser_rotation == pytest.approx(furthest, abs=1e-4)
    for limit, refused in (
        (largest + 1e-4, True),
        (furthest - 1e-4, True),
        (furthest + 1e-4, False),
        (4.0, False),
    ):
        limits = Limits(chaser_attitude=largest + 1e-4, chaser_rotation=limit)
        failures = found.judged(limits=limits)
        assert bool(failures) is refused
        if refused:
            words_of_limit = f"beyond limits.chaser_rotation of {limit:g} rad"
            the_one(failures, Status.LIMIT_VIOLATED, "the chaser has rotated by", words_of_limit)
            words = failures[0].finding.split()
            angle, told = float(words[words.index("by") + 1]), float(words[words.index("=") + 1])
            assert angle == pytest.approx(furthest, abs=1e-4)
            assert told == pytest.approx(time, abs=0.03)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(4))
@both_ways
def test_the_rotation_counts_from_the_first_point_whatever_the_attitude_is_there(
    seed: int, sign: float
) -> None:
    joints = resting(POSTURE).swelling(seed % 3, PLACES["between"], sign)
    attitude = Rotation.random(random_state=seed)
    found = made(robot(), joints, np.zeros(6), PLACE, attitude)
    angles = rotated(found)
    same = rotated(swinging("between", seed % 3, sign))
    np.testing.assert_allclose(angles, same, rtol=0.0, atol=1e-7)
    assert np.abs(euler(found)).max() > 0.3, "the axes are turned"
    for aside, refused in ((-1e-4, True), (1e-4, False)):
        failures = found.judged(limits=Limits(chaser_rotation=float(angles.max()) + aside))
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.LIMIT_VIOLATED, "beyond limits.chaser_rotation")


@pytest.mark.sampled
@pytest.mark.parametrize("axis", range(3))
@both_ways
def test_a_chaser_that_spins_rotates_by_no_more_than_half_a_turn(axis: int, sign: float) -> None:
    """It goes round several times; a limit of half a turn allows that, and nothing less does."""
    spin = np.concatenate([np.zeros(3), sign * 2.0 * np.eye(3)[axis]])
    found = made(robot(), resting(POSTURE), spin, PLACE)
    measured = found.measured().max_chaser_rotation
    assert np.pi - 0.02 < measured <= np.pi
    assert measured >= rotated(found).max() - 0.02
    for limit, refused in ((1.0, True), (3.0, True), (np.pi, False), (np.inf, False)):
        words = [one.finding for one in found.judged(limits=Limits(chaser_rotation=limit))]
        assert any("limits.chaser_rotation" in each for each in words) is refused, limit


@both_ways
def test_the_metric_of_attitude_is_that_of_the_points_up_to_the_goal(sign: float) -> None:
    joints = resting(POSTURE).stepping(0, GOAL - 1, sign * 0.5).stepping(0, GOAL, sign * 0.5)
    found = made(robot(), joints, np.zeros(6), PLACE)
    at_goal = np.abs(euler(found)[found.time == STEP * GOAL]).max()
    assert at_goal > 0.01
    assert found.plan.metrics.max_chaser_euler == pytest.approx(at_goal, abs=1e-7)
    # From the one point to the other the rates of the samples are zero: they alone count.
    assert found.plan.metrics.joint_path_length == 0.0
