"""What samples mean, and which are none: against frames and bodies placed by Pinocchio alone."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance, random_robot
from handmade_plans import DENSE, PLACES, POINTS, Made, free_motion, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE, POSTURE, TWIST

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.distance.allowed_contact import may_touch, split_pairs
from ff_planner_ros.planning.distance.contact import deepest_contact
from ff_planner_ros.planning.distance.start_room import room_of_pairs
from ff_planner_ros.planning.motion.followed import steps_of
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME, METRICS
from ff_planner_ros.planning.motion.motion import chaser_motion, from_trajectory, to_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.configuration import system_state
from ff_planner_ros.robot.model import robot_from_urdf_text

NAMES = [item.name for item in fields(Trajectory)]
QUATERNIONS = ["chaser_quaternions_xyzw", "ee_quaternions_xyzw"]


@cache
def swinging(name: str = "six joints") -> Made:
    robot = robot_from_urdf_text(*ROBOTS[name])
    joints = resting(np.linspace(-0.9, 1.2, robot.joints))
    joints = joints.swelling(1, PLACES["between"], -0.3).bulging(0, PLACES["tail"], 0.2)
    return made(robot, joints, TWIST, PLACE, Rotation.from_rotvec([0.7, -1.1, 1.9]))


@pytest.mark.parametrize("name", ROBOTS)
def test_samples_are_the_configurations_and_velocities_that_made_them(name: str) -> None:
    found = swinging(name)
    robot, motion, made_q = found.problem.robot, found.plan.trajectory, found.q[::DENSE]
    q, v = from_trajectory(robot, motion)
    signs = np.sign(np.sum(q[:, 3:7] * made_q[:, 3:7], axis=1))[:, None]
    np.testing.assert_allclose(q[:, :3], made_q[:, :3], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(signs * q[:, 3:7], made_q[:, 3:7], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(q[:, 7:], made_q[:, 7:], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(v, found.v, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_configurations_and_velocities_are_told_as_frames_have_them(name: str) -> None:
    found = swinging(name)
    robot, motion, q, v = found.problem.robot, found.plan.trajectory, *dense_samples(found)
    joints = motion.joint_accelerations
    of_base = [free_motion(robot, *at)[0] for at in zip(q, v, joints, strict=True)]
    told = to_trajectory(robot, motion.time, q, v, np.hstack([of_base, joints]))
    states = [system_state(robot, *at) for at in zip(q, v, strict=True)]
    for values in (vars(told), chaser_motion(states)):
        for key, value in values.items():
            wanted = getattr(motion, key)
            if key in QUATERNIONS:
                value = value * np.sign(np.sum(value * wanted, axis=1))[:, None]
            scale = max(1.0, np.abs(wanted).max())
            np.testing.assert_allclose(value, wanted, rtol=0.0, atol=1e-11 * scale, err_msg=key)


def dense_samples(found: Made) -> tuple[Array, Array]:
    return found.q[::DENSE], found.v


def refused(status: Status, name: str, **changes: Array) -> None:
    found = swinging()
    with pytest.raises(InvalidInput) as refusal:
        require_sound_samples(found.problem.robot, replace(found.plan.trajectory, **changes))
    assert refusal.value.status is status
    assert refusal.value.field == name


def test_samples_of_a_motion_are_sound() -> None:
    found = swinging()
    robot, motion = found.problem.robot, found.plan.trajectory
    require_sound_samples(robot, motion)
    two = {name: getattr(motion, name)[:2] for name in NAMES}
    require_sound_samples(robot, replace(motion, **two))
    far = motion.chaser_positions - 0.9e15
    require_sound_samples(robot, replace(motion, chaser_positions=far))


@pytest.mark.parametrize("name", NAMES[1:])
def test_an_array_of_the_wrong_shape_is_refused(name: str) -> None:
    values = getattr(swinging().plan.trajectory, name)
    for wrong in (values[1:], values[:, 1:], np.hstack([values, values[:, :1]]), values[:, 0]):
        refused(Status.WRONG_SIZE, name, **{name: wrong})


def test_one_point_is_no_motion() -> None:
    motion = swinging().plan.trajectory
    for count in (0, 1):
        refused(
            Status.WRONG_SIZE, "time", **{name: getattr(motion, name)[:count] for name in NAMES}
        )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("point", [0, POINTS - 1])
def test_a_sample_that_is_no_number_or_too_large_is_refused(name: str, point: int) -> None:
    for value, status in (
        (np.nan, Status.NOT_FINITE),
        (-np.inf, Status.NOT_FINITE),
        (1.1e15, Status.OUT_OF_RANGE),
        (-1.1e15, Status.OUT_OF_RANGE),
    ):
        values = getattr(swinging().plan.trajectory, name).copy()
        values[point] = value
        refused(status, name, **{name: values})


@pytest.mark.parametrize("name", QUATERNIONS)
@pytest.mark.parametrize("point", [0, 5, POINTS - 1])
def test_a_quaternion_that_is_no_rotation_is_refused(name: str, point: int) -> None:
    for length in (0.9, 1.1):
        values = getattr(swinging().plan.trajectory, name).copy()
        values[point] *= length
        refused(Status.BAD_QUATERNION, name, **{name: values})


@pytest.mark.parametrize("point", [1, 6, POINTS - 1])
def test_times_that_do_not_increase_are_refused(point: int) -> None:
    for back in (0.5, 0.6):
        time = swinging().plan.trajectory.time.copy()
        time[point] -= back
        refused(Status.OUT_OF_RANGE, "time", time=time)


@pytest.mark.parametrize("seed", range(6))
def test_the_deepest_contact_is_that_which_coal_finds(seed: int) -> None:
    """Of bodies with each other and with spheres, where these are at the time."""
    robot, rng = random_robot(3), np.random.default_rng(seed)
    found = made(robot, resting(POSTURE), np.zeros(6), PLACE).problem
    center = PLACE + rng.normal(scale=0.6, size=(3, 3))
    drift = rng.normal(scale=0.1, size=3)
    spheres = tuple(
        Obstacle.sphere(f"s{k}", place, 0.05 + 0.1 * k, drift) for k, place in enumerate(center)
    )
    problem, time = replace(found, obstacles=spheres), 1.7
    q = pin.neutral(robot.model)
    q[:3] = PLACE
    q[3:7] = Rotation.random(random_state=seed).as_quat()
    q[7:] = rng.uniform(-2.0, 2.0, robot.joints)
    placed = [
        (b.solid, at, b.name) for b, at in zip(robot.bodies, body_placements(robot, q), strict=True)
    ]
    distances = {
        frozenset((placed[a][2], placed[b][2])): coal_distance(*placed[a][:2], *placed[b][:2])
        for a, b in robot.pairs
    }
    for sphere in spheres:
        there = pin.SE3(np.eye(3), sphere.center + time * drift)
        for solid, at, name in placed:
            distance = coal_distance(solid, at, coal.Sphere(sphere.radius), there)
            distances[frozenset((name, sphere.id))] = distance
    deepest = min(distances, key=lambda names: distances[names])
    contact = deepest_contact(problem, q, time)
    assert distances[deepest] < 0.0, "nothing touches"
    assert contact is not None
    assert frozenset((contact.first, contact.second)) == deepest
    assert contact.distance == pytest.approx(distances[deepest], abs=1e-6)
    assert contact.obstacle is (contact.second in {sphere.id for sphere in spheres})


def test_near_the_goal_is_within_the_contact_distance_of_where_the_grasp_is() -> None:
    found = made(random_robot(3), resting(POSTURE), np.zeros(6), PLACE)
    pair = next(n for n, room in enumerate(room_of_pairs(found.problem)) if room > 0.0)
    a, b = (found.problem.robot.bodies[k].link for k in found.problem.robot.pairs[pair])
    drift = np.array([0.1, 0.0, 0.0])
    moving = replace(found.problem.target, linear_velocity=drift)
    problem = replace(
        found.problem, target=moving, allowed_collisions=(f"{a}/{b}",), contact_distance=0.1
    )
    # The end effector rests where the grasp will be: a tenth of a metre from it a second before.
    q, goal, split = found.q[0], problem.duration, split_pairs(problem)
    for time, may in ((goal, True), (goal - 0.99, True), (goal - 1.01, False)):
        assert (pair in may_touch(problem, split, q, time)) is may
    nothing = replace(problem, allowed_collisions=())
    assert not may_touch(nothing, split_pairs(nothing), q, goal).size


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_contact_is_with_an_obstacle_where_it_is_by_then(sign: float) -> None:
    found = made(random_robot(3), resting(POSTURE), np.zeros(6), PLACE)
    robot, q = replace(found.problem.robot, pairs=()), found.q[0]
    at, body = body_placements(robot, q)[0], robot.bodies[0]
    there = at.act(body.placement_in_joint.actInv(body.center_in_joint))
    drift = sign * np.array([0.0, 3.0, 0.0])
    sphere = Obstacle.sphere("s", there - 2.0 * drift, 0.01, drift)
    comes = replace(found.problem, robot=robot, obstacles=(sphere,))
    assert deepest_contact(comes, q, 0.0) is None
    assert deepest_contact(comes, q, 4.0) is None
    touching = deepest_contact(comes, q, 2.0)
    assert touching is not None
    assert touching.second == "s"


def test_near_the_goal_the_pairs_that_may_touch_are_no_contact() -> None:
    """All pairs that touch in a folded posture are told, but the one that is allowed."""
    found = made(random_robot(3), resting(POSTURE), np.zeros(6), PLACE)
    robot, rng = found.problem.robot, np.random.default_rng(3)
    for _ in range(200):
        q = found.q[0].copy()
        q[7:] = rng.uniform(-3.0, 3.0, robot.joints)
        touching = deepest_contact(found.problem, q)
        if touching is not None:
            break
    assert touching is not None
    links = [name.split("#")[0] for name in (touching.first, touching.second)]
    near = replace(found.problem, allowed_collisions=("/".join(links),), contact_distance=100.0)
    other = deepest_contact(near, q)
    assert other is None or {other.first, other.second} != {touching.first, touching.second}
    before = deepest_contact(replace(near, contact_distance=1e-6), q)
    assert before is not None
    assert before.distance == touching.distance


def test_near_the_goal_what_is_allowed_is_no_contact() -> None:
    """A body in a sphere around it: allowed at the goal, not before, and no other body."""
    found = made(random_robot(3), resting(POSTURE), np.zeros(6), PLACE)
    robot = replace(found.problem.robot, pairs=())
    q, number = found.q[0], len(robot.bodies) - 1
    body = robot.bodies[number]
    place = body_placements(robot, q)[number].act(
        body.placement_in_joint.actInv(body.center_in_joint)
    )
    problem = replace(
        found.problem,
        robot=robot,
        obstacles=(Obstacle.sphere("moon", PLACE + 9.0, 0.1), Obstacle.sphere("s", place, 0.02)),
    )
    near = replace(problem, contact_distance=0.1)
    touching = deepest_contact(near, q)
    assert touching is not None
    allowed = (f"{touching.first.split('#')[0]}/s",)
    assert deepest_contact(replace(near, allowed_collisions=allowed), q) is None
    away = replace(near.target, position=near.target.position + np.array([0.2, 0.0, 0.0]))
    far = replace(near, allowed_collisions=allowed, target=away)
    assert deepest_contact(far, q) is None, "it touches at the start"
    begin = replace(far.start, joint_positions=far.start.joint_positions + 0.5)
    assert deepest_contact(replace(far, start=begin), q) is not None
    other = (f"{touching.first.split('#')[0]}/moon",)
    assert deepest_contact(replace(near, allowed_collisions=other), q) is not None


def test_fast_joints_take_more_steps_either_way() -> None:
    """In none of them joints and chaser turn by more than a tenth of a radian."""
    time = np.array([0.0, 0.5, 2.5, 3.0])
    for sign in (1.0, -1.0):
        rates = np.zeros((4, 6))
        rates[2] = sign * np.array([0.0, 4.0, 0.0, 3.0, 0.0, 0.0])
        joints = JointMotion(time, 0 * rates, rates, 0 * rates)
        for spin, pieces in ((0.0, 140), (2.0, 180)):
            twist = np.concatenate([np.zeros(3), [0.0, -spin, 0.0], np.zeros(6)])
            found, times = steps_of(joints, twist, 1)
            assert found == pieces
            assert len(times) == 3 * pieces + 1
            np.testing.assert_array_equal(times[::pieces], time)
        slow = JointMotion(time, 0 * rates, 0 * rates, 0 * rates)
        assert steps_of(slow, np.zeros(12), 1)[0] == 33
        assert steps_of(slow, np.zeros(12), 4)[0] == 36


def test_a_metric_is_told_in_its_unit_and_of_several_the_largest() -> None:
    told = {
        "min_clearance": (-0.00123, "-1.2 mm"),
        "max_chaser_euler": (np.pi / 6, "30.00 deg"),
        "max_chaser_rotation": (np.pi / 4, "45.00 deg"),
        "min_velocity_margin": (-np.pi / 180, "-1.00 deg/s"),
        "min_acceleration_margin": (np.pi / 90, "2.00 deg/s2"),
        "joint_path_length": (1.23456, "1.2346 rad"),
        "peak_joint_torques": ((0.5, 2.25, 1.0), "2.25 N m"),
        "final_orientation_error": (np.pi / 180, "1.00000 deg"),
        "momentum_error": (1.23e-10, "1.2e-10 relative"),
        "min_singular_value": (0.25, "0.25"),
    }
    for name, (value, words) in told.items():
        assert METRIC_BY_NAME[name].text(value) == words
    for name, words in (
        ("min_clearance", "no obstacles"),
        ("min_self_clearance", "no pairs"),
        ("min_acceleration_margin", "no limits"),
        ("min_torque_margin", "no limits"),
    ):
        assert METRIC_BY_NAME[name].text(np.inf) == words
        assert METRIC_BY_NAME[name].text(np.nan) == "none"
    assert [metric.name for metric in METRICS] == list(METRIC_BY_NAME)
