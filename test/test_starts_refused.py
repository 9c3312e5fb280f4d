"""A start that no plan can begin at is refused before any search: both ways, and not too soon."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from handmade_plans import SETTINGS, Made, arm, from_lines, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE, POSTURE, TWIST

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.paths.start_motion import least_highest_positions, least_highest_rates
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem, Sphere
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
    assert f"needs {found:.4g} N m" in message
    assert f"joints.acceleration[joint_{joint + 1}]" in message
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
    others = [Sphere(f"far_{k}", PLACE + 30.0, 1.0) for k in range(3)]
    for depth in (5e-4, -1e-6):
        sphere = Sphere("near", center, away.min() + depth, np.array([0.5, 0.0, 0.0]))
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
