"""Samples that are no free motion, miss the goal or come near a singularity: refused by name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from handmade_plans import GOAL, PLACES, POINTS, SETTINGS, STEP, Made, judged, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import AT_POINTS, PLACE, POSTURE, TWIST, the_one
from test_planar_base import TESTBED_URDF

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.problem.problem import Parametrisation
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, load_robot, robot_from_urdf_text

both_ways = pytest.mark.parametrize("sign", [1.0, -1.0])
at_points = pytest.mark.parametrize("place", AT_POINTS)
ATTITUDE = Rotation.from_rotvec([0.7, -1.1, 1.9])  # far from that of the inertial frame


@cache
def tumbling() -> Made:
    joints = resting(POSTURE).bulging(2, PLACES["between"], 0.3).stepping(0, PLACES["end"], 0.1)
    return made(robot_from_urdf_text(*ROBOTS["six joints"]), joints, TWIST, PLACE, ATTITUDE)


@cache
def without_momentum(swings: bool = True) -> Made:
    joints = resting(POSTURE).bulging(2, PLACES["between"], 0.3 if swings else 0.0)
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    return made(robot, joints, np.zeros(6), PLACE, ATTITUDE)


def spoilt(values: Array, point: int, by: Array) -> Array:
    changed = values.copy()
    changed[point] += by
    return changed


@cache
def chasers_own(found: Made) -> float:
    """The largest momentum of the chaser alone, about the inertial origin."""
    model, data = found.problem.robot.model, found.problem.robot.model.createData()
    own = 0.0
    for q, v in zip(found.q[::40], found.v, strict=True):
        pin.forwardKinematics(model, data, q, v)
        base, twist, inertia = data.oMi[1], data.v[1], model.inertias[1]
        moving = twist.linear + np.cross(twist.angular, inertia.lever)
        linear = inertia.mass * base.rotation @ moving
        angular = base.rotation @ inertia.inertia @ twist.angular
        angular += np.cross(base.act(inertia.lever), linear)
        own = max(own, float(np.linalg.norm(np.append(linear, angular))))
    return own


@pytest.mark.law("PLAN-03")
@at_points
@both_ways
def test_a_chaser_that_moves_as_if_it_were_pushed_is_refused(place: str, sign: float) -> None:
    """By exactly what its momentum is off, about the inertial origin, of what it is."""
    found, point = tumbling(), AT_POINTS[place]
    robot, off = found.problem.robot, sign * 1e-7 * np.eye(3)[point % 3]
    data = robot.model.createData()
    pin.computeCentroidalMomentum(robot.model, data, found.q[0], found.v[0])
    start = np.append(data.hg.linear, data.hg.angular + np.cross(data.com[0], data.hg.linear))
    motion = found.plan.trajectory
    moved = spoilt(motion.chaser_linear_velocities, point, off)
    answer = found.spoilt(chaser_linear_velocities=moved)
    q = found.q[point * (len(found.q) - 1) // (POINTS - 1)]
    pushed = pin.computeTotalMass(robot.model) * off
    change = np.append(pushed, np.cross(pin.centerOfMass(robot.model, data, q), pushed))
    wanted = np.linalg.norm(change) / max(np.linalg.norm(start), chasers_own(found))
    told = replace(found, plan=answer).measured().momentum_error
    assert told == pytest.approx(wanted, rel=1e-3, abs=1e-11)
    assert wanted > SETTINGS.momentum_tolerance
    the_one(judged(found.problem, answer), Status.CHECK_FAILED, "momentum_error is")


@pytest.mark.law("PLAN-03")
@at_points
@both_ways
def test_a_chaser_that_turns_as_if_it_were_pushed_is_refused(place: str, sign: float) -> None:
    motion = tumbling().plan.trajectory
    off = sign * np.array([0.0, 1e-7, 0.0])
    turned = spoilt(motion.chaser_angular_velocities, AT_POINTS[place], off)
    found = tumbling().told(chaser_angular_velocities=turned)
    the_one(found, Status.CHECK_FAILED, "momentum_error is")


@at_points
@both_ways
def test_a_system_that_turns_as_if_it_were_twisted_is_refused(place: str, sign: float) -> None:
    """About its own centre of mass: the linear momentum stays what it is."""
    found, point = tumbling(), AT_POINTS[place]
    model, motion = found.problem.robot.model, found.plan.trajectory
    data = model.createData()
    center = pin.centerOfMass(model, data, found.q[point * (len(found.q) - 1) // (POINTS - 1)])
    off = sign * np.array([0.0, 0.0, 1e-7])
    aside = np.cross(off, motion.chaser_positions[point] - center)
    twisted = found.told(
        chaser_angular_velocities=spoilt(motion.chaser_angular_velocities, point, off),
        chaser_linear_velocities=spoilt(motion.chaser_linear_velocities, point, aside),
    )
    the_one(twisted, Status.CHECK_FAILED, "momentum_error is")


def test_momentum_is_that_of_the_start_and_not_of_the_first_sample() -> None:
    found = tumbling()
    start = found.problem.start
    faster = start.linear_velocity_chaser_in_inertial + np.array([0.0, 0.0, 1e-7])
    failures = found.judged(start=replace(start, linear_velocity_chaser_in_inertial=faster))
    the_one(failures, Status.CHECK_FAILED, "momentum_error is")


def test_without_any_momentum_the_error_is_in_parts_of_the_chasers_own() -> None:
    found = without_momentum()
    model, data = found.problem.robot.model, found.problem.robot.model.createData()
    own = chasers_own(found)
    off = np.array([1e-6, 0.0, 0.0])
    moved = spoilt(found.plan.trajectory.chaser_linear_velocities, GOAL, off)
    answer = replace(found, plan=found.spoilt(chaser_linear_velocities=moved))
    pushed = pin.computeTotalMass(model) * off
    center = pin.centerOfMass(model, data, found.q[GOAL * 40])
    wanted = np.linalg.norm(np.append(pushed, np.cross(center, pushed))) / own
    assert answer.measured().momentum_error == pytest.approx(wanted, rel=1e-4)


def test_of_a_system_at_rest_the_error_is_in_parts_of_what_carries_it_off() -> None:
    """By the goal's tolerance in the time of the plan."""
    found = without_momentum(swings=False)
    model, data = found.problem.robot.model, found.problem.robot.model.createData()
    off = np.array([0.0, -1e-9, 0.0])
    moved = spoilt(found.plan.trajectory.chaser_linear_velocities, 3, off)
    answer = replace(found, plan=found.spoilt(chaser_linear_velocities=moved))
    center = pin.centerOfMass(model, data, found.q[0])
    change = np.linalg.norm(np.append(off, np.cross(center, off)))
    wanted = change / (SETTINGS.position_tolerance / found.problem.duration)
    assert answer.measured().momentum_error == pytest.approx(wanted, rel=1e-6)


@at_points
@both_ways
@pytest.mark.parametrize("joint", [0, 5])
def test_a_torque_that_does_not_make_the_motion_is_refused(
    place: str, sign: float, joint: int
) -> None:
    torques = tumbling().plan.trajectory.joint_torques
    off = spoilt(torques, AT_POINTS[place], sign * 2e-6 * np.eye(6)[joint])
    found = tumbling().told(joint_torques=off)
    the_one(found, Status.CHECK_FAILED, "torque_error is 2e-06 N m, allowed is 1e-06 N m")
    # All others are exact: what is allowed is the amount itself.
    assert not tumbling().told(joint_torques=torques + 0.4 * (off - torques))


@pytest.mark.law("PLAN-01")
@both_ways
@pytest.mark.parametrize("joint", [0, 5])
def test_a_jump_of_joint_rates_at_the_start_is_refused(sign: float, joint: int) -> None:
    found = tumbling()
    # With other rates the start has another momentum; that is not the question here.
    settings = replace(SETTINGS, momentum_tolerance=1.0)
    for jump, refused in ((0.0102, True), (0.0099, False)):
        rates = found.problem.start.joint_velocities + sign * jump * np.eye(6)[joint]
        start = replace(found.problem.start, joint_velocities=rates)
        failures = judged(replace(found.problem, start=start), found.plan, settings)
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.CHECK_FAILED, "start_velocity_jump is 0.0102 rad/s")


def test_rates_that_change_after_the_start_are_no_jump() -> None:
    found = made(
        robot_from_urdf_text(*ROBOTS["six joints"]),
        resting(POSTURE).bulging(1, PLACES["start"], 0.05),
        TWIST,
        PLACE,
    )
    first, second = found.plan.trajectory.joint_velocities[:2]
    assert np.abs(second - first).max() > 0.1
    assert found.measured().start_velocity_jump == pytest.approx(0.0, abs=1e-12)


def jacobian_at_zero_momentum(found: Made, q: Array) -> Array:
    robot = found.problem.robot
    data = robot.model.createData()
    jacobian = pin.computeFrameJacobian(
        robot.model, data, q, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED
    )
    by_velocity = pin.computeCentroidalMap(robot.model, data, q)
    follows = -np.linalg.solve(by_velocity[:, :6], by_velocity[:, 6:])
    return np.asarray(jacobian[:, 6:] + jacobian[:, :6] @ follows)


@pytest.mark.law("PLAN-12")
@at_points
def test_a_singular_posture_is_refused_wherever_it_is(place: str) -> None:
    """The wrist of the paper's arm in line: but for one point the arm is bent."""
    point = AT_POINTS[place]
    joints = resting(np.array([0.2, -0.2, 0.1, -1.1, -1.8, 1.1, -2.2]))
    positions = joints.positions.copy()
    positions[point] = [0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.02, 0.0]
    robot = robot_from_urdf_text(*ROBOTS["lemur"])
    found = made(robot, replace(joints, positions=positions), np.zeros(6), PLACE)
    least = [
        np.linalg.svd(jacobian_at_zero_momentum(found, q), compute_uv=False)[-1]
        for q in found.q[::40]
    ]
    assert int(np.argmin(least)) == point
    assert min(least) < SETTINGS.singular_value_threshold < np.delete(least, point).min()
    assert found.plan.metrics.min_singular_value == pytest.approx(min(least), abs=1e-9)
    failures = found.judged()
    the_one(failures, Status.SINGULAR, "dynamic singularity at", f"t = {point * STEP:.2f} s")
    # Joint splines do not invert it: there it is a posture as any other.
    assert not judged(found.problem, replace(found.plan, family=Parametrisation.JOINT_SPLINE))
    for aside, refused in ((2e-6, True), (0.0, False)):
        settings = replace(SETTINGS, singular_value_threshold=float(min(least)) + aside)
        assert bool(judged(found.problem, found.plan, settings)) is refused


@cache
def on_a_table() -> Made:
    robot = load_robot(
        TESTBED_URDF, "satellite", "end_effector", Base.PLANAR, geometry=Geometry.LINES
    )
    joints = resting(np.array([1.5, -2.0, -0.5])).bulging(1, PLACES["between"], -0.3)
    twist = np.array([0.02, -0.03, 0.0, 0.0, 0.0, 0.05])
    return made(robot, joints, twist, np.array([1.0, -2.0, 0.37]))


LEAVES = {
    "rises or sinks by": ("chaser_positions", 2, "m"),
    "moves along z at": ("chaser_linear_velocities", 2, "m/s"),
    "turns about x and y at": ("chaser_angular_velocities", 0, "rad/s"),
}


def of_plane(found: list[Failure]) -> list[str]:
    return [one.finding for one in found if "leaves the plane of its base" in one.finding]


@pytest.mark.law("PLAN-16")
@at_points
@both_ways
@pytest.mark.parametrize("words", [*LEAVES, "turns about y", "tilts by"])
def test_a_chaser_that_leaves_its_table_is_refused(place: str, sign: float, words: str) -> None:
    found, point = on_a_table(), AT_POINTS[place]
    assert not found.judged()
    name, axis, unit = LEAVES.get(words, ("chaser_angular_velocities", 1, "rad/s"))
    motion = found.plan.trajectory
    for size, refused in ((1.1e-6, True), (0.9e-6, False)):
        if words == "tilts by":
            name, unit = "chaser_quaternions_xyzw", "rad"
            values = motion.chaser_quaternions_xyzw.copy()
            tilt = Rotation.from_rotvec([0.0, sign * size, 0.0])
            values[point] = (tilt * Rotation.from_quat(values[point])).as_quat()
        else:
            by = sign * size * np.eye(3)[axis]
            values = spoilt(getattr(motion, name), point, by)
        told = of_plane(found.told(**{name: values}))
        assert len(told) == refused
        if refused:
            words = "turns about x and y at" if words == "turns about y" else words
            assert f"{words} up to 1.1e-06 {unit}" in told[0]
