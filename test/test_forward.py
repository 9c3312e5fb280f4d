"""A measured state carried forward: against the laws of mechanics and an integrator of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from oracle import golden
from paper_equations import PaperTerms, paper_terms
from robots import ROBOTS, random_state
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.forward import carried_forward, driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState

SECONDS = 2.5
URDF, BASE, TIP = ROBOTS["six joints"]


NOT_COMPARED = ("joint_accelerations", "wheel_momenta")  # there are none


def moving(robot: Robot, seed: int = 0) -> SystemState:
    """A state from which the arm can move a while and the chaser tumbles."""
    state = random_state(robot, np.random.default_rng(seed))
    return replace(state, joint_positions=0.5 * state.joint_positions)


def swinging(robot: Robot, positions: Array, begin: float) -> JointMotion:
    """Every joint its own quintics, through points that are not equally far apart."""
    rng = np.random.default_rng(3)
    time = begin + np.array([0.0, 0.4, 1.1, 1.9])
    shape = (len(time), robot.joints)
    offsets = rng.uniform(-0.4, 0.4, shape)
    offsets[0] = 0.0
    rates, accelerations = rng.uniform(-0.3, 0.3, (2, *shape))
    return JointMotion(time, positions + offsets, rates, accelerations)


@pytest.mark.parametrize("begin", [-1.7, -1.1, -0.5, 0.0, 0.3])
@pytest.mark.parametrize("seconds", [0.0, 0.2, 0.4, 1.0, SECONDS])
def test_points_that_are_over_or_after_the_time_do_not_count(begin: float, seconds: float) -> None:
    robot = robot_from_urdf_text(URDF, BASE, TIP)
    state = moving(robot)
    whole = swinging(robot, state.joint_positions, begin)
    ours = carried_forward(robot, state, seconds, whole.between(0.0, seconds))
    theirs = carried_forward(robot, state, seconds, whole)
    for item in fields(SystemState):
        np.testing.assert_array_equal(getattr(ours, item.name), getattr(theirs, item.name))


def momentum_of(robot: Robot, state: SystemState) -> Array:
    q, v = configuration(robot, state)
    return total_momentum(robot, robot.model.createData(), q, v)


def off(one: SystemState, other: SystemState) -> float:
    """Largest difference of pose, joints and velocities; quaternions by the angle between."""
    differences = [
        np.abs(getattr(one, item.name) - getattr(other, item.name)).max()
        for item in fields(one)
        if item.name not in ("quaternion_chaser_to_inertial_xyzw", *NOT_COMPARED)
    ]
    turns = [Rotation.from_quat(at.quaternion_chaser_to_inertial_xyzw) for at in (one, other)]
    return float(max(*differences, (turns[0].inv() * turns[1]).magnitude()))


def terms_of(r_ch: Array, rotation: Array, theta: Array) -> PaperTerms:
    return paper_terms(URDF, BASE, TIP, r_ch=r_ch, rotation_ch=rotation, theta=theta)


def by_the_papers_equations(
    state: SystemState, pieces: list[tuple[float, float, JointMotion | Array]]
) -> SystemState:
    """Integrate Eq. (27) with rotation matrices by DOP853; joints by rates or by a motion."""
    r_ch, theta = state.position_chaser_in_inertial, state.joint_positions
    R = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw).as_matrix()
    terms = terms_of(r_ch, R, theta)
    twist = np.concatenate(
        [state.linear_velocity_chaser_in_inertial, state.angular_velocity_chaser_in_inertial]
    )
    momentum = terms.H_ch @ twist + terms.H_m @ state.joint_velocities  # (24)

    def rates_at(time: float, what: JointMotion | Array) -> Array:
        return what.at(np.array([time]))[1][0] if isinstance(what, JointMotion) else what

    def chaser_twist(r_ch: Array, R: Array, theta: Array, rates: Array) -> Array:
        terms = terms_of(r_ch, R, theta)
        return np.linalg.solve(terms.H_ch, momentum - terms.H_m @ rates)  # (27)

    y = np.concatenate([r_ch, R.ravel(), theta])
    for begin, end, what in pieces:

        def derivative(time: float, y: Array, what: JointMotion | Array = what) -> Array:
            rates, R = rates_at(time, what), y[3:12].reshape(3, 3)
            twist = chaser_twist(y[:3], R, y[12:], rates)
            return np.concatenate([twist[:3], np.cross(twist[3:], R, axisb=0).T.ravel(), rates])

        knots = what.time if isinstance(what, JointMotion) else np.empty(0)
        inside = knots[(begin < knots) & (knots < end)]
        for a, b in pairwise([begin, *inside, end]):
            y = solve_ivp(derivative, (a, b), y, method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
    rates = rates_at(end, what)
    R = y[3:12].reshape(3, 3)
    twist = chaser_twist(y[:3], R, y[12:], rates)
    attitude = Rotation.from_matrix(R).as_quat()
    return SystemState(y[:3], attitude, twist[:3], twist[3:], y[12:], rates)


# What the arm does, and from when to when [s], along a motion that begins so long after the state.
FOLLOWED = {
    "begins later": (0.3, [("goes on", 0.0, 0.3), ("moves", 0.3, 1.5)]),
    "ends while it runs": (0.0, [("moves", 0.0, 1.5)]),
    "began before": (-0.7, [("moves", 0.0, 1.0)]),
    "is over before": (-1.0, [("moves", 0.0, 0.9), ("held", 0.9, 2.5)]),
    "begins after": (3.0, [("goes on", 0.0, 1.5)]),
    "was over": (-4.0, [("held", 0.0, 1.5)]),
}


def driven_by_nothing(seconds: float) -> SystemState:
    state = moving(robot_from_urdf_text(URDF, BASE, TIP))
    return by_the_papers_equations(state, [(0.0, seconds, state.joint_velocities)])


def along_a_motion(which: str) -> SystemState:
    robot = robot_from_urdf_text(URDF, BASE, TIP)
    state, (begin, pieces) = moving(robot), FOLLOWED[which]
    motion = swinging(robot, state.joint_positions + 0.01, begin)
    of = {"goes on": state.joint_velocities, "moves": motion, "held": np.zeros(robot.joints)}
    return by_the_papers_equations(state, [(a, b, of[what]) for what, a, b in pieces])


INTEGRATIONS: dict[str, Callable[[], SystemState]] = {
    **{f"{time:g} s": partial(driven_by_nothing, time) for time in (0.7, SECONDS, 10.0)},
    **{f"a motion {which}": partial(along_a_motion, which) for which in FOLLOWED},
}


@pytest.mark.law("NODE-03")
@pytest.mark.parametrize("seconds", [0.7, SECONDS])
def test_an_arm_that_nothing_drives_goes_on_as_an_independent_integrator_says(
    seconds: float,
) -> None:
    robot = robot_from_urdf_text(URDF, BASE, TIP)
    state = moving(robot)
    expected = golden(f"{seconds:g} s")
    assert off(carried_forward(robot, state, seconds, None), expected) < 1e-8
    assert off(state, expected) > 0.05


@pytest.mark.parametrize(("speed", "away"), [(10.0, 0.0), (8e3, 7e6)])
def test_ten_seconds_at_orbital_speed_turn_as_at_rest(speed: float, away: float) -> None:
    """The laws are the same in every inertial frame; far away the ninth decimal of a metre ends."""
    robot = robot_from_urdf_text(URDF, BASE, TIP)
    state = moving(robot)
    at_rest = golden("10 s")
    velocity, origin = speed * np.array([0.6, 0.0, -0.8]), away * np.array([0.0, 0.6, 0.8])

    def seen(state: SystemState, time: float) -> SystemState:
        place = state.position_chaser_in_inertial + (origin + time * velocity)
        rate = state.linear_velocity_chaser_in_inertial + velocity
        return replace(
            state, position_chaser_in_inertial=place, linear_velocity_chaser_in_inertial=rate
        )

    found = carried_forward(robot, seen(state, 0.0), 10.0, None)
    assert off(found, seen(at_rest, 10.0)) < 1e-7
    turn = found.angular_velocity_chaser_in_inertial - at_rest.angular_velocity_chaser_in_inertial
    assert np.abs(turn).max() < 1e-9


@pytest.mark.parametrize("which", FOLLOWED)
def test_an_arm_that_follows_a_motion_goes_as_an_independent_integrator_says(which: str) -> None:
    robot = robot_from_urdf_text(URDF, BASE, TIP)
    state, (begin, pieces) = moving(robot), FOLLOWED[which]
    motion = swinging(robot, state.joint_positions + 0.01, begin)
    *_, (_, _, seconds) = pieces
    found = carried_forward(robot, state, seconds, motion)
    assert off(found, golden(f"a motion {which}")) < 1e-8


def test_momentum_stays_and_the_centre_of_mass_moves_in_a_straight_line(robot: Robot) -> None:
    state = moving(robot)
    motion = swinging(robot, state.joint_positions, 0.3)
    after = carried_forward(robot, state, SECONDS, motion)
    momentum = momentum_of(robot, state)
    assert momentum_of(robot, after) == pytest.approx(momentum, rel=1e-9, abs=1e-9)
    centers = [
        pin.centerOfMass(robot.model, robot.model.createData(), configuration(robot, at)[0])
        for at in (state, after)
    ]
    drift = SECONDS * momentum[:3] / pin.computeTotalMass(robot.model)
    assert centers[1] - centers[0] == pytest.approx(drift, abs=1e-8)
    assert after.position_chaser_in_inertial - state.position_chaser_in_inertial != pytest.approx(
        drift, abs=1e-3
    )


def test_a_motion_turned_back_leads_back(robot: Robot) -> None:
    """With all velocities reversed the system returns on its own path."""
    state = moving(robot)
    motion = swinging(robot, state.joint_positions, 0.0)
    state = carried_forward(robot, state, 0.1, motion)  # its rates are the motion's now
    motion = replace(motion, time=motion.time - 0.1)
    there = carried_forward(robot, state, 1.5, motion)
    backwards = JointMotion(
        1.5 - motion.time[::-1],
        motion.positions[::-1],
        -motion.velocities[::-1],
        motion.accelerations[::-1],
    )
    back = reversed_in_time(carried_forward(robot, reversed_in_time(there), 1.5, backwards))
    assert off(back, state) < 1e-8


def reversed_in_time(state: SystemState) -> SystemState:
    return replace(
        state,
        linear_velocity_chaser_in_inertial=-state.linear_velocity_chaser_in_inertial,
        angular_velocity_chaser_in_inertial=-state.angular_velocity_chaser_in_inertial,
        joint_velocities=-state.joint_velocities,
    )


@pytest.mark.parametrize("axis", range(3))
def test_a_spin_about_a_principal_axis_goes_on_for_ever(axis: int) -> None:
    """With its arm held the system is a rigid body: it keeps turning about its centre of mass."""
    robot = robot_from_urdf_text(URDF, BASE, TIP)
    state = moving(robot)
    R = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
    terms = terms_of(state.position_chaser_in_inertial, R.as_matrix(), state.joint_positions)
    mass, moment = terms.M[0, 0], terms.M[3:6, :3]  # (15): of the arm about the chaser's centre
    lever = np.array([moment[2, 1], moment[0, 2], moment[1, 0]]) / mass
    about_center = terms.M[3:6, 3:6] - mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    omega = 0.6 * np.linalg.eigh(about_center)[1][:, axis]
    drift = np.array([0.05, -0.02, 0.03])
    spinning = replace(
        state,
        linear_velocity_chaser_in_inertial=drift - np.cross(omega, lever),
        angular_velocity_chaser_in_inertial=omega,
        joint_velocities=np.zeros(robot.joints),
    )
    after = carried_forward(robot, spinning, 4.0, None)
    turned = Rotation.from_rotvec(4.0 * omega)
    center = state.position_chaser_in_inertial + lever + 4.0 * drift
    expected = SystemState(
        center - turned.apply(lever),
        (turned * R).as_quat(),
        drift - np.cross(omega, turned.apply(lever)),
        omega,
        state.joint_positions,
        np.zeros(robot.joints),
    )
    assert off(after, expected) < 1e-8


def test_a_system_that_only_drifts_takes_everything_along(robot: Robot) -> None:
    still = moving(robot)
    drift = np.array([0.03, -0.02, 0.01])
    state = replace(
        still,
        linear_velocity_chaser_in_inertial=drift,
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_velocities=np.zeros(robot.joints),
    )
    there = state.position_chaser_in_inertial + 60.0 * drift
    expected = replace(state, position_chaser_in_inertial=there)
    assert off(carried_forward(robot, state, 60.0, None), expected) < 1e-9


@pytest.mark.parametrize("begin", [None, 0.5], ids=["no motion", "a motion that begins later"])
def test_in_no_time_nothing_changes_to_the_last_bit(robot: Robot, begin: float | None) -> None:
    state = moving(robot)
    motion = None if begin is None else swinging(robot, state.joint_positions, begin)
    after = carried_forward(robot, state, 0.0, motion)
    for item in fields(state):
        assert np.array_equal(getattr(after, item.name), getattr(state, item.name))


def test_it_does_not_matter_in_how_many_goes(robot: Robot) -> None:
    state = moving(robot)
    motion = swinging(robot, state.joint_positions + 0.01, 0.3)
    once = carried_forward(robot, state, 2.5, motion)
    first = carried_forward(robot, state, 1.0, motion)
    twice = carried_forward(robot, first, 1.5, replace(motion, time=motion.time - 1.0))
    assert off(once, twice) < 1e-8


def test_the_tracking_error_stays_and_the_rates_are_the_motions(lemur: Robot) -> None:
    """The measured arm lags 0.01 rad behind its motion and its rates are noisy."""
    state = moving(lemur)
    motion = swinging(lemur, state.joint_positions + 0.01, -0.5)
    measured = replace(state, joint_positions=motion.at(np.zeros(1))[0][0] - 0.01)
    after = carried_forward(lemur, measured, 0.9, motion)
    positions, rates, _ = motion.at(np.array([0.9]))
    assert after.joint_positions == pytest.approx(positions[0] - 0.01, abs=1e-12)
    assert after.joint_velocities == pytest.approx(rates[0], abs=1e-12)


@pytest.mark.parametrize("seconds", [0.0, 0.4, 1.1, 1.3, 1.9])
def test_while_a_motion_runs_rates_and_accelerations_are_its_own(
    lemur: Robot, seconds: float
) -> None:
    """At its first and last moment, too, and even if no time passes after the measurement."""
    state = moving(lemur)
    motion = swinging(lemur, state.joint_positions, 0.0)
    after = carried_forward(lemur, state, seconds, motion)
    _, rates, accelerations = motion.at(np.array([seconds]))
    assert after.joint_velocities == pytest.approx(rates[0], abs=1e-12)
    assert after.joint_accelerations == pytest.approx(accelerations[0], abs=1e-12)
    assert momentum_of(lemur, after) == pytest.approx(momentum_of(lemur, state), abs=1e-8)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("begin", [None, 3.0], ids=["no motion", "a motion that begins later"])
def test_without_a_motion_accelerations_stay_what_they_are_known_to_be(
    lemur: Robot, begin: float | None, known: bool
) -> None:
    state = moving(lemur)
    accelerations = np.linspace(-0.1, 0.1, lemur.joints) if known else None
    state = replace(state, joint_accelerations=accelerations)
    motion = None if begin is None else swinging(lemur, state.joint_positions, begin)
    after = carried_forward(lemur, state, 1.5, motion)
    assert np.array_equal(after.joint_accelerations, accelerations)
    assert after.joint_velocities == pytest.approx(state.joint_velocities, abs=1e-12)


def test_after_its_end_a_motion_is_held(lemur: Robot) -> None:
    state = moving(lemur)
    motion = swinging(lemur, state.joint_positions, 0.0)
    after = carried_forward(lemur, state, 5.0, motion)
    assert after.joint_positions == pytest.approx(motion.positions[-1], abs=1e-12)
    assert np.array_equal(after.joint_velocities, np.zeros(lemur.joints))
    assert np.array_equal(after.joint_accelerations, np.zeros(lemur.joints))


def test_half_way_through_a_plan_the_system_is_where_the_plan_says(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """The plan came by the velocity map on the end effector's path, not by its joints' motion."""
    motion = lemur_plan.trajectory
    joints = joint_motion(motion, start=0.5)
    start = replace(lemur_capture.start, joint_velocities=motion.joint_velocities[0])
    before = carried_forward(lemur_capture.robot, reversed_in_time(start), 0.5, None)
    found = carried_forward(
        lemur_capture.robot, reversed_in_time(before), 0.5 + motion.time[25], joints
    )
    assert found.position_chaser_in_inertial == pytest.approx(motion.chaser_positions[25], abs=1e-6)
    assert found.joint_positions == pytest.approx(motion.joint_positions[25], abs=1e-9)
    turns = Rotation.from_quat(
        [found.quaternion_chaser_to_inertial_xyzw, motion.chaser_quaternions_xyzw[25]]
    )
    assert (turns[0].inv() * turns[1]).magnitude() < 1e-6


def test_the_error_falls_with_the_fourth_power_of_the_step(robot: Robot) -> None:
    state = moving(robot)
    q, _ = configuration(robot, state)
    momentum = momentum_of(robot, state)
    motion = swinging(robot, state.joint_positions, 0.0)

    def at_end(steps: int) -> Array:
        time = np.concatenate(
            [np.linspace(a, b, steps, endpoint=False) for a, b in pairwise(motion.time)]
        )
        time = np.append(time, motion.time[-1])
        return driven(robot, q, momentum, motion, time)[0][-1]

    fine = at_end(80)
    coarse, middle = (np.linalg.norm(at_end(steps) - fine) for steps in (5, 10))
    assert coarse / middle == pytest.approx(16.0, rel=0.2)


def test_the_accelerations_are_those_of_the_velocities(robot: Robot) -> None:
    state = moving(robot)
    q, _ = configuration(robot, state)
    motion = swinging(robot, state.joint_positions, 0.0)
    time = np.linspace(0.45, 1.05, 1201)
    _, v, accelerations = driven(robot, q, momentum_of(robot, state), motion, time)
    differences = (v[2:] - v[:-2]) / (time[2:] - time[:-2])[:, None]
    assert accelerations[1:-1] == pytest.approx(differences, abs=1e-4)


@pytest.mark.parametrize("begin", [-2.0, 3.0])
def test_it_does_not_matter_what_the_clock_says_when_a_motion_begins(
    robot: Robot, begin: float
) -> None:
    """A system that drifts, too, is where it is at the first time, and goes on from there."""
    state = moving(robot)
    q, _ = configuration(robot, state)
    momentum, time = momentum_of(robot, state), np.linspace(0.0, 1.9, 40)
    expected = driven(robot, q, momentum, swinging(robot, state.joint_positions, 0.0), time)
    later = swinging(robot, state.joint_positions, begin)
    found = driven(robot, q, momentum, later, begin + time)
    assert np.linalg.norm(momentum[:3]) > 1.0
    for one, other in zip(found, expected, strict=True):
        assert one == pytest.approx(other, abs=1e-9)


@pytest.mark.parametrize("seconds", [-1e-9, np.nan, np.inf])
def test_a_time_that_is_none_is_refused(lemur: Robot, seconds: float) -> None:
    with pytest.raises(InvalidInput, match="seconds") as refused:
        carried_forward(lemur, moving(lemur), seconds, None)
    assert refused.value.status in (Status.OUT_OF_RANGE, Status.NOT_FINITE)


@pytest.mark.parametrize("rate", [1e3, 1e10, 1e30, 1e90])
@pytest.mark.parametrize("what", ["chaser", "joints"])
def test_what_turns_too_far_until_a_plan_begins_is_refused_and_not_carried_forward(
    lemur: Robot, what: str, rate: float
) -> None:
    """At 1e10 rad/s the times of its steps alone would take a terabyte."""
    state = moving(lemur)
    if what == "chaser":
        fast = replace(state, angular_velocity_chaser_in_inertial=np.array([0.0, rate, 0.0]))
    else:
        fast = replace(state, joint_velocities=rate * np.eye(lemur.joints)[4])
    with pytest.raises(InvalidInput, match="too far to be foretold") as refused:
        carried_forward(lemur, fast, 10.0, None)
    assert refused.value.status is Status.OUT_OF_RANGE
    assert refused.value.field == f"{what}.{'angular_' if what == 'chaser' else ''}velocity"
