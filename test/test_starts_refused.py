"""A start that no plan can begin at is refused before any search: both ways, and not too soon."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import lemur_with_bodies
from handmade_plans import SETTINGS, Made, arm, from_lines, made, resting
from robots import LEMUR_SCENARIO, ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE, POSTURE, TWIST

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.distance.contact import deepest_contact
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.paths.start_motion import least_highest_positions, least_highest_rates
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.problem import Limits, Obstacle, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import robot_from_urdf_text

JERK = 10.0  # that no plan exceeds [rad/s3]
both_ways = pytest.mark.parametrize("sign", [1.0, -1.0])
each_joint = pytest.mark.parametrize("joint", [0, 3, 5])


@cache
def resting_arm() -> Made:
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    attitude = Rotation.from_rotvec([0.7, -1.1, 1.9])
    return made(robot, resting(POSTURE), TWIST, PLACE, attitude)


def starting(joint: int, rate: float, acceleration: float | None) -> PlanningProblem:
    problem, one = resting_arm().problem, np.eye(6)[joint]
    accelerations = None if acceleration is None else acceleration * one
    start = replace(problem.start, joint_velocities=rate * one, joint_accelerations=accelerations)
    return replace(problem, start=start)


def limited(problem: PlanningProblem, name: str, joint: int, value: float) -> PlanningProblem:
    limits = getattr(problem.robot, name).copy()
    limits[joint] = value
    return replace(problem, robot=replace(problem.robot, **{name: limits}))


def refusal_of(problem: PlanningProblem, status: Status = Status.START_OUTSIDE_LIMITS) -> str:
    with pytest.raises(InvalidInput) as refused:
        require_plannable(problem, SETTINGS)
    assert refused.value.status is status
    return str(refused.value)


def test_a_start_within_all_limits_is_not_refused() -> None:
    require_plannable(resting_arm().problem, SETTINGS)


@each_joint
@both_ways
def test_a_joint_that_begins_outside_its_limits_is_refused(joint: int, sign: float) -> None:
    name = "upper_position_limits" if sign > 0.0 else "lower_position_limits"
    problem = starting(joint, 0.0, None)
    # A plan may end so far beyond, and another one begins where it ended.
    require_plannable(limited(problem, name, joint, POSTURE[joint] - sign * 0.9e-4), SETTINGS)
    message = refusal_of(limited(problem, name, joint, POSTURE[joint] - sign * 1.1e-4))
    assert f"joints.position[joint_{joint + 1}] is" in message


@each_joint
@both_ways
def test_a_joint_that_begins_too_fast_is_refused(joint: int, sign: float) -> None:
    problem = starting(joint, sign * 0.3, None)
    slow = limited(problem, "velocity_limits", joint, 0.29)
    require_plannable(slow, SETTINGS)
    kept = Limits(joint_velocities=True)
    message = refusal_of(replace(slow, limits=kept))
    assert f"joints.velocity[joint_{joint + 1}] is {sign * 0.3:.6f} rad/s" in message
    allowed = limited(problem, "velocity_limits", joint, 0.3)
    require_plannable(replace(allowed, limits=kept), SETTINGS)


@each_joint
@both_ways
@pytest.mark.parametrize("rate", [0.2, 0.0, -0.05])
def test_a_joint_that_becomes_too_fast_whatever_follows_is_refused(
    joint: int, sign: float, rate: float
) -> None:
    """Its acceleration is brought to zero in a / j, and adds a^2 / 2 j until then."""
    problem = replace(starting(joint, sign * rate, sign * 2.0), limits=Limits(True))
    fastest = rate + 2.0**2 / (2.0 * JERK)
    require_plannable(limited(problem, "velocity_limits", joint, fastest), SETTINGS)
    message = refusal_of(limited(problem, "velocity_limits", joint, fastest * (1 - 2e-4)))
    assert f"joints.acceleration[joint_{joint + 1}] is {sign * 2.0:.6f} rad/s2" in message


@pytest.mark.law("PLAN-29")
@each_joint
@both_ways
def test_a_joint_that_slows_down_is_not_refused(joint: int, sign: float) -> None:
    problem = replace(starting(joint, sign * 0.2, -sign * 0.5), limits=Limits(True))
    require_plannable(limited(problem, "velocity_limits", joint, 0.2), SETTINGS)


@each_joint
@both_ways
def test_a_joint_that_begins_to_accelerate_too_much_is_refused(joint: int, sign: float) -> None:
    def allowing(most: float) -> PlanningProblem:
        limits = np.full(6, 50.0)
        limits[joint] = most
        problem = starting(joint, 0.0, sign * 0.5)
        return replace(problem, limits=Limits(joint_accelerations=tuple(limits.tolist())))

    require_plannable(allowing(0.5), SETTINGS)
    message = refusal_of(allowing(0.5 * (1 - 2e-4)))
    assert f"joints.acceleration[joint_{joint + 1}] is {sign * 0.5:.6f} rad/s2" in message


@each_joint
@both_ways
def test_a_start_that_needs_too_much_torque_is_refused(joint: int, sign: float) -> None:
    """While the chaser tumbles; the torque is that of the mass matrix written out."""
    joints = resting(POSTURE)
    accelerations = joints.accelerations.copy()
    accelerations[0, joint] = sign * 3.0
    joints = replace(joints, accelerations=accelerations)
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    problem = made(robot, joints, 5.0 * TWIST, PLACE).problem
    found = made(robot, joints, 5.0 * TWIST, PLACE).torques[0, joint]
    assert abs(found) > 0.3
    weak = limited(problem, "effort_limits", joint, abs(found) - 1e-5)
    message = refusal_of(weak)
    assert f"joint_{joint + 1} needs {found:.5g} N m" in message
    assert "joints.acceleration is [" in message
    require_plannable(replace(weak, limits=Limits(joint_torques=False)), SETTINGS)
    require_plannable(limited(problem, "effort_limits", joint, abs(found)), SETTINGS)


def braked(values: tuple[float, ...], seconds: float) -> Array:
    """Positions and rates while a joint is braked as hard as can be."""
    position, rate, acceleration = values
    t = np.linspace(0.0, seconds, 200_001)
    return np.array(
        [
            position + rate * t + acceleration * t**2 / 2 - JERK * t**3 / 6,
            rate + acceleration * t - JERK * t**2 / 2,
        ]
    )


@pytest.mark.parametrize(
    ("position", "rate", "acceleration"),
    [
        (0.3, 0.4, 0.0),
        (0.3, 0.4, 2.0),
        (-0.2, 0.4, -1.0),
        (-0.2, -0.1, 3.0),
        (0.1, 0.0, 1.0),
        (0.5, -0.3, 0.5),
        (0.5, 0.3, -4.0),
        (0.0, 0.0, 0.0),
        (0.5, -0.4, 3.0),  # it turns round twice, and is highest when it begins
    ],
)
def test_a_joint_gets_as_high_as_one_that_is_braked_at_once(
    position: float, rate: float, acceleration: float
) -> None:
    values = position, rate, acceleration
    for seconds in (0.1, 5.0):
        highest = braked(values, seconds)[0].max()
        found = least_highest_positions(*(np.array([value]) for value in values), seconds)
        assert found[0] == pytest.approx(highest, abs=1e-9)
    fastest = braked(values, 5.0)[1].max()
    assert least_highest_rates(np.array([rate]), np.array([acceleration]))[0] == pytest.approx(
        fastest, abs=1e-9
    )


@each_joint
@both_ways
@pytest.mark.parametrize("acceleration", [None, 1.0, -1.0])
def test_a_joint_that_cannot_stop_before_its_limit_is_refused(
    joint: int, sign: float, acceleration: float | None
) -> None:
    highest = braked((POSTURE[joint] * sign, 0.4, acceleration or 0.0), 4.0)[0].max()
    accelerated = None if acceleration is None else sign * acceleration
    problem = starting(joint, sign * 0.4, accelerated)
    name = "upper_position_limits" if sign > 0.0 else "lower_position_limits"
    require_plannable(limited(problem, name, joint, sign * (highest - 0.9e-4)), SETTINGS)
    message = refusal_of(limited(problem, name, joint, sign * (highest - 1.1e-4)))
    assert f"joints.velocity[joint_{joint + 1}] is {sign * 0.4:.6f} rad/s" in message


@pytest.mark.parametrize("line", range(6))
@pytest.mark.parametrize("number", [0, 2])
def test_a_start_with_any_line_of_the_arm_in_any_obstacle_is_refused(
    line: int, number: int
) -> None:
    """Where the obstacle is when the plan begins, though it moves."""
    problem, points = resting_arm().problem, arm(resting_arm().problem.robot, resting_arm().q[0])
    along = points[line + 1] - points[line]
    aside = np.cross(along, [0.3, 0.5, -0.8])
    center = points[line] + 0.6 * along + 0.02 * aside / np.linalg.norm(aside)
    away = from_lines(points, center)
    assert away.argmin() == line
    ends = [*problem.robot.joint_names, problem.robot.tip_link]
    others = [Obstacle.sphere(f"far_{k}", PLACE + 30.0, 1.0) for k in range(3)]
    for depth in (5e-4, -1.1e-5):
        # The one that it does not touch moves away: another would be hit.
        way = np.array([0.5, 0.0, 0.0]) if depth > 0.0 else 0.5 * aside / np.linalg.norm(aside)
        sphere = Obstacle.sphere("near", center, away.min() + depth, way)
        obstacles = (*others[:number], sphere, *others[number:])
        asked = replace(problem, obstacles=obstacles)
        if depth < 0.0:
            require_plannable(asked, SETTINGS)
            continue
        message = refusal_of(asked, Status.START_IN_COLLISION)
        assert (
            f"obstacles[near] is around the link from {ends[line]} to {ends[line + 1]}" in message
        )
        assert "0.0005 m deep" in message


def beside(problem: PlanningProblem, gap: float, velocity: Array | None = None) -> PlanningProblem:
    """The problem with a sphere so far from a line of the arm, on the side that it moves to.

    Without a velocity the sphere moves with the line.
    """
    robot = problem.robot
    q, _ = configuration(robot, problem.start)
    points = arm(robot, q)
    line = 3
    middle, along = points[line : line + 2].mean(axis=0), points[line + 1] - points[line]
    normal = np.cross(along, [0.3, 0.5, -0.8])
    normal /= np.linalg.norm(normal)
    ahead = carried_forward(robot, problem.start, 1e-4, None)
    moved = arm(robot, configuration(robot, ahead)[0])[line : line + 2].mean(axis=0) - middle
    if moved @ normal < 0.0:
        normal = -normal
    drift = moved / 1e-4 if velocity is None else velocity
    sphere = Obstacle.sphere("near", middle + normal * (0.05 + gap), 0.05, drift)
    return replace(problem, obstacles=(sphere,))


@pytest.mark.law("PLAN-29")
@pytest.mark.parametrize("known", [True, False])
def test_a_start_that_moves_into_an_obstacle_whatever_follows_is_refused_at_once(
    known: bool,
) -> None:
    """With the clearance that it has and the one that it needs; with that it is searched for."""
    problem = starting(0, 0.3, 0.0 if known else None)
    still = np.zeros(3)
    words = refusal_of(beside(problem, 2e-5, still), Status.START_IN_COLLISION)
    assert words.startswith("obstacles[near] is 0.020 mm from the link from joint_4 to joint_5")
    (needed,) = (float(one) for one in re.findall(r"at this speed ([\d.]+) mm are needed", words))
    assert needed > 0.02
    require_plannable(beside(problem, 1.02e-3 * needed, still), SETTINGS)
    require_plannable(beside(problem, 4e-3, still), SETTINGS)  # in 0.2 s it goes 7 mm
    again = refusal_of(beside(problem, 0.9e-3 * needed, still), Status.START_IN_COLLISION)
    assert "start further away, or slower" in again


def test_a_start_as_near_that_moves_with_the_obstacle_or_away_from_it_is_not_refused() -> None:
    problem = starting(0, 0.3, 0.0)
    require_plannable(beside(problem, 2e-5), SETTINGS)  # the obstacle goes with the line
    require_plannable(beside(starting(0, 0.0, 0.0), 2e-5), SETTINGS)


def test_an_obstacle_that_comes_at_a_resting_start_is_refused_at_once() -> None:
    problem = beside(starting(0, 0.0, 0.0), 2e-5)
    (sphere,) = problem.obstacles
    q, _ = configuration(problem.robot, problem.start)
    towards = arm(problem.robot, q)[3:5].mean(axis=0) - sphere.center
    coming = sphere.with_motion(
        velocity=sphere.motion.velocity + 0.1 * towards / np.linalg.norm(towards)
    )
    words = refusal_of(replace(problem, obstacles=(coming,)), Status.START_IN_COLLISION)
    assert "which nears it by 0.1 m/s" in words


@pytest.mark.parametrize("moving", [False, True])
def test_a_start_near_the_grasp_and_beside_the_corridor_is_refused(moving: bool) -> None:
    """Where the grasp is at the start."""
    found = resting_arm()
    robot, duration = found.problem.robot, found.problem.duration
    tip = arm(robot, found.q[0])[-1]
    drift: dict[str, Any] = {"linear_velocity": [0.05, 0.0, -0.1]} if moving else {}
    way = duration * np.array(drift.get("linear_velocity", [0.0, 0.0, 0.0]))
    target = found.problem.target
    axes = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    for aside, before, refused in (
        (0.05, 0.1, True),
        (-0.05, 0.1, True),
        (0.0, 0.1, False),
        (0.0, -0.05, True),  # behind the grasp
        (0.05, 0.3, False),  # further than the distance
    ):
        grasp = tip - axes @ [aside, 0.0, -before] + way
        asked = replace(
            found.problem,
            target=replace(target, position=grasp, **drift),
            approach=Approach(np.array([0.0, 0.0, 1.0]), 0.2),
        )
        if refused:
            assert "approach.distance is 0.2 m" in refusal_of(asked)
        else:
            require_plannable(asked, SETTINGS)


def test_a_body_that_moves_into_an_obstacle_whatever_follows_is_refused_at_once() -> None:
    problem = load_scenario(LEMUR_SCENARIO)
    robot, way = lemur_with_bodies(), np.array([0.0, 0.0, 1.0])
    q, _ = configuration(robot, problem.start)
    middle = arm(robot, q)[-1]

    def with_sphere(off: float, speed: float = 0.0) -> PlanningProblem:
        sphere = Obstacle.sphere("near", middle + off * way, 0.05, -speed * way)
        return replace(problem, robot=robot, obstacles=(sphere,))

    inside, outside = 0.0, 9.0
    while outside - inside > 1e-7:
        off = (inside + outside) / 2
        touches = deepest_contact(with_sphere(off), q, within=1e-5) is not None
        inside, outside = (off, outside) if touches else (inside, off)
    words = refusal_of(with_sphere(outside + 2e-5, 0.3), Status.START_IN_COLLISION)
    assert re.match(r"obstacles\[near\] is 0\.0[012]\d mm from link_", words)
    assert "are needed at the start" in words
    require_plannable(with_sphere(outside + 2e-5, -0.3), SETTINGS)
