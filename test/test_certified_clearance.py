"""What is certified of an arm and spheres, where geometry says how near they come.

Each motion comes nearest between two of its points, and breaks nothing at any of them. Of the
check's certificate and of the search's, of every interval, and with spheres of every kind.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from core_rows import certified_by_core
from near_bodies import certified_clearance
from scipy.optimize import minimize_scalar
from straight_arms import panel_about, straight_arm, told, turning

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP
from ff_planner_ros.planning.distance.search_certificate import CERTIFICATE_GAP, search_distance
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import (
    Objective,
    Obstacle,
    PlanningProblem,
    Target,
    attached,
)
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles
from ff_planner_ros.robot.configuration import system_state
from ff_planner_ros.robot.model import robot_from_urdf_text

# The first joint is in the origin: the arm of 1 m sweeps the circle about it.
ARM = straight_arm(0.0, 1.0)
TIMES = np.array([0.0, 0.5, 1.5, 2.0, 4.0])
REST = told(TIMES, np.zeros((5, 1)), np.zeros((5, 1)))


def require(motion: FollowedMotion, spheres: Sequence[Obstacle], true: float) -> None:
    """Hold both certificates against the true clearance, and each against its gap."""
    asked = ARM, motion.q, motion.v, motion.time, spheres
    assert true - CHECK_GAP - 1e-9 <= certified_clearance(*asked) <= true + 1e-9
    assert true - CERTIFICATE_GAP - 1e-9 <= certified_by_core(*asked) <= true + 1e-9


def on_circle(angle: float, distance: float) -> Array:
    return distance * np.array([np.cos(angle), np.sin(angle), 0.0])


def test_an_arm_that_speeds_up_past_a_sphere() -> None:
    """At rest at first: where it is after a part s of the way goes with its cube."""
    motion = told([0.0, 1.0], np.array([[0.0], [1.0]]), np.array([[0.0], [3.0]]))
    require(motion, [Obstacle.sphere("rock", on_circle(0.5, 1.05), 0.02)], 0.03)


def test_a_line_that_slides_out_towards_a_sphere_and_back() -> None:
    """As far as at 0.3 m half-way, where it is nobody's point."""
    links = "".join(
        f'<link name="{name}"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name in ("chaser", "link_1", "tip")
    )
    limit = '<limit lower="-9" upper="9" velocity="9" effort="9"/></joint>'
    robot = robot_from_urdf_text(
        f'<robot name="telescope">{links}<joint name="joint_1" type="revolute">'
        f'<parent link="chaser"/><child link="link_1"/><axis xyz="0 0 1"/>{limit}'
        '<joint name="joint_2" type="prismatic"><parent link="link_1"/><child link="tip"/>'
        f'<origin xyz="0.5 0 0"/><axis xyz="1 0 0"/>{limit}</robot>'
    )
    motion = told([0.0, 1.0], np.zeros((2, 2)), np.array([[0.0, 1.2], [0.0, -1.2]]))
    rock = Obstacle.sphere("rock", [1.0, 0.0, 0.0], 0.1)
    found = certified_by_core(robot, motion.q, motion.v, motion.time, [rock])
    assert 0.1 - CERTIFICATE_GAP - 1e-9 <= found <= 0.1 + 1e-9


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("part", [0.13, 0.5, 0.77])
@pytest.mark.parametrize("interval", range(4))
def test_an_arm_that_turns_past_a_sphere(interval: int, part: float, way: float) -> None:
    motion = turning(TIMES, np.array([-0.3 * way]), np.array([0.5 * way]))
    when = TIMES[interval] + part * (TIMES[interval + 1] - TIMES[interval])
    angle = way * (0.5 * when - 0.3)
    rock = Obstacle.sphere("rock", on_circle(angle, 1.05), 0.02)
    require(motion, [rock], 0.03)
    # One that stays near does not hide it, in whichever order they are told.
    idle = Obstacle.sphere("idle", [0.0, 0.0, 0.5], 0.455)
    require(motion, [idle, rock], 0.03)
    require(motion, [rock, idle], 0.03)
    require(motion, [idle], 0.045)


@pytest.mark.parametrize("pace", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_turns_far_from_an_arm_at_rest_in_steps_of_seconds(way: float, pace: float) -> None:
    """On a circle of 1 m about a place 4 m away, half a radian a step: nearest is its near end."""
    times = pace * TIMES
    rest, rate = told(times, np.zeros((5, 1)), np.zeros((5, 1))), way * 0.5 / pace
    begin = np.pi - rate * 3.1 * pace
    require(rest, panel_about(4.0, begin, rate), 1.7)


@pytest.mark.parametrize("step", [0.5, 8.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_makes_half_a_turn_a_step_is_seen_though_it_is_far_at_all_points(
    way: float, step: float
) -> None:
    """To either side of its hub at the points, and before it in between, or behind."""
    times = step * np.arange(5.0)
    rest = told(times, np.zeros((5, 1)), np.zeros((5, 1)))
    body = TargetBody(
        position=np.array([4.0, 0.0, 0.0]),
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.eye(3),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        angular_velocity=[0.0, 0.0, way * np.pi / step],
        obstacles=(AttachedObstacle.sphere("panel", [0.0, 1.0, 0.0], 0.3),),
    )
    panel = [one for one in attached(body) if one.is_sphere]
    idle = Obstacle.sphere("idle", [0.0, 0.0, 2.4], 0.3)
    require(rest, [idle], 2.1)
    require(rest, [idle, *panel], 1.7)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_arm_that_swings_out_and_back_between_two_points(way: float) -> None:
    """At both it is at zero: 2 rad/s out, and as fast back, is half a radian half-way."""
    rates = way * np.array([[0.0], [2.0], [-2.0], [0.0], [0.0]])
    times = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    motion = told(times, np.zeros((5, 1)), rates)
    rock = Obstacle.sphere("rock", on_circle(0.9 * way, 1.0), 0.05)
    require(motion, [rock], np.sin(0.4) - 0.05)


@pytest.mark.parametrize("near", [0.5e-4, 0.99e-4, 1.9e-4, 1e-3, 0.05])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_base_that_comes_near_and_turns_back_between_two_points(near: float, axis: int) -> None:
    """It brakes steadily and turns half-way, after half of what its first rate would make."""
    times, base, twists = np.array([0.0, 2.0]), np.zeros((2, 7)), np.zeros((2, 6))
    base[:, 6], twists[:, axis] = 1.0, np.array([2.0, -2.0]) * near
    motion = told(times, np.zeros((2, 1)), np.zeros((2, 1)), base, twists)
    rock = Obstacle.sphere(
        "rock", [0.5, 0.0, 0.0] + np.array([1.0, 0.9, 0.9])[axis] * np.eye(3)[axis], 0.1
    )
    require(motion, [rock], (0.4 if axis == 0 else 0.8) - near)


@pytest.mark.law("PLAN-10")
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("when", [0.21, 0.9, 1.8, 2.7, 3.9])
def test_a_sphere_that_flies_past_a_resting_arm(when: float, side: float) -> None:
    """At 3 m/s, and the plan's time counts, not the number of the point."""
    velocity = np.array([0.0, 3.0 * side, 0.0])
    nearest = np.array([0.6, 0.0, 0.3])
    flying = Obstacle.sphere("debris", nearest - when * velocity, 0.1, velocity)
    require(REST, [flying], 0.2)
    away = Obstacle.sphere("far", [0.5, 0.0, -0.5], 0.25)
    require(REST, [away, flying], 0.2)


@pytest.mark.parametrize("spin", [1.1, -1.1])
@pytest.mark.parametrize("drift", [0.0, 0.4])
def test_a_sphere_that_swings_past_on_a_body_that_spins_and_drifts(
    spin: float, drift: float
) -> None:
    """A boom of 2 m about the y axis, 3.5 m before the tip; the drift is across."""
    body = TargetBody(
        position=[4.5, 0.0, 0.0],
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.eye(3),
        grasp_position=[0.0, 9.0, 0.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        linear_velocity=[0.0, drift, 0.0],
        angular_velocity=[0.0, spin, 0.0],
        obstacles=(
            AttachedObstacle.sphere("hub", [0.0, 0.0, 0.0], 0.1),
            AttachedObstacle.sphere("boom", [0.0, 0.0, -2.0], 0.3),
        ),
    )
    spheres = tuple(attached(body))

    def center(time: float) -> Array:
        return np.array([4.5 - 2.0 * np.sin(spin * time), drift * time, -2.0 * np.cos(spin * time)])

    def apart(time: float) -> float:
        return float(np.linalg.norm(center(time) - [1.0, 0.0, 0.0])) - 0.3

    dense = np.linspace(0.0, 4.0, 4001)
    first = dense[np.argmin([apart(at) for at in dense])]
    ends = max(first - 1e-3, 0.0), min(first + 1e-3, 4.0)
    near = minimize_scalar(apart, bounds=ends, options={"xatol": 1e-12})
    require(REST, spheres, float(near.fun))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_base_that_flies_past_a_sphere_and_one_that_turns_past_it(way: float) -> None:
    """The base alone moves: at 2 m/s along y, and about z at 0.7 rad/s."""
    count = len(TIMES)
    base, twists = np.zeros((count, 7)), np.zeros((count, 6))
    base[:, 1], base[:, 6], twists[:, 1] = 2.0 * way * TIMES, 1.0, 2.0 * way
    flying = told(TIMES, np.zeros((count, 1)), np.zeros((count, 1)), base, twists)
    require(flying, [Obstacle.sphere("rock", [1.4, 6.3 * way, 0.0], 0.1)], 0.3)
    half = 0.35 * way * TIMES
    base, twists = np.zeros((count, 7)), np.zeros((count, 6))
    base[:, 5], base[:, 6], twists[:, 5] = np.sin(half), np.cos(half), 0.7 * way
    turned = told(TIMES, np.zeros((count, 1)), np.zeros((count, 1)), base, twists)
    require(turned, [Obstacle.sphere("rock", on_circle(0.7 * way * 3.1, 1.2), 0.1)], 0.1)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("sphere_way", [3.0, -3.0, 2.1])
def test_a_base_and_a_sphere_that_fly_at_each_other_or_one_after_the_other(
    way: float, sphere_way: float
) -> None:
    """They meet at 3.1 s: at 5 m/s, at 1 m/s, and at 0.1 m/s."""
    count, meeting = len(TIMES), 3.1
    base, twists = np.zeros((count, 7)), np.zeros((count, 6))
    base[:, 1], base[:, 6], twists[:, 1] = 2.0 * way * TIMES, 1.0, 2.0 * way
    flying = told(TIMES, np.zeros((count, 1)), np.zeros((count, 1)), base, twists)
    velocity = np.array([0.0, sphere_way * way, 0.0])
    place = np.array([1.3, 2.0 * way * meeting, 0.0]) - meeting * velocity
    require(flying, [Obstacle.sphere("debris", place, 0.2, velocity)], 0.1)


@pytest.mark.law("PLAN-09")
@pytest.mark.parametrize("depth", [0.004, 0.19])
def test_what_is_pierced_between_the_points_is_as_deep_as_it_is(depth: float) -> None:
    """A sphere of 0.2 m that the tip, or nearly its middle, goes through."""
    motion = turning(TIMES, np.array([-0.3]), np.array([0.5]))
    require(motion, [Obstacle.sphere("rock", on_circle(1.2, 1.2 - depth), 0.2)], -depth)


@pytest.mark.parametrize("true", [-0.0107, -0.0004, 0.0006, 0.0008, 0.0012, 0.03])
def test_the_search_takes_a_closer_look_at_what_it_may_touch(true: float) -> None:
    motion = turning(TIMES, np.array([-0.3]), np.array([0.5]))
    rock = Obstacle.sphere("rock", on_circle(1.2, 1.2 + true), 0.2)
    problem = PlanningProblem(
        robot=ARM,
        start=system_state(ARM, motion.q[0], motion.v[0]),
        target=Target(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),  # of the posture
        duration=4.0,
        points=len(TIMES),
        obstacles=(rock,),
        objective=Objective(1.0, 0.0),
        posture=Posture(at_rest=True),
    )
    left = ClearOfObstacles().slack(problem, motion)
    assert min(true - CERTIFICATE_GAP, 0.0) <= left <= true


def test_without_spheres_nothing_is_near() -> None:
    assert certified_clearance(ARM, REST.q, REST.v, REST.time, ()) == np.inf
    assert search_distance(ARM, REST, (), np.arange(0), 1, 0.0) == np.inf
