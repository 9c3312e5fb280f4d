"""Whatever touches what it must not, at any place of a plan, is refused by name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance, lemur_with_bodies, random_robot
from handmade_plans import (
    DENSE,
    PLACES,
    SETTINGS,
    Made,
    arm,
    from_lines,
    made,
    resting,
)
from robots import ROBOTS
from test_limits_by_hand import AT_POINTS, PLACE, POSTURE, the_one

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.distance.contact import deepest_contact, way_out
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

FAR = [Obstacle.sphere(name, PLACE + 30.0, 0.5) for name in ("moon", "sun")]
everywhere = pytest.mark.parametrize("place", [*PLACES, "at the goal", "at the end"])


@cache
def reaching_out(place: str, bodies: bool) -> tuple[Made, int]:
    """The arm swings at one place alone; and the dense time at which it is furthest aside."""
    robot = random_robot(3) if bodies else robot_from_urdf_text(*ROBOTS["six joints"])
    joints = resting(POSTURE)
    if place in PLACES:
        joints = joints.swelling(0, PLACES[place], 0.5)
        furthest = DENSE * PLACES[place] + DENSE // 2
    else:
        positions, point = joints.positions.copy(), AT_POINTS[place.split()[-1]]
        positions[point, 0] += 0.5
        joints, furthest = replace(joints, positions=positions), DENSE * point
    return made(robot, joints, np.zeros(6), PLACE), furthest


def in_the_way(found: Made, furthest: int, drift: Array) -> Obstacle:
    """A sphere that comes to where the end effector is at its furthest, a little beyond."""
    q = found.q[furthest]
    at_rest = q.copy()
    at_rest[7] = POSTURE[0]
    there = arm(found.problem.robot, q)[-1]
    aside = there - arm(found.problem.robot, at_rest)[-1]
    center = there + 0.3 * aside / np.linalg.norm(aside)
    return Obstacle.sphere("bolt", center - found.time[furthest] * drift, 0.1, drift)


def test_the_penalty_is_that_of_the_points_by_the_nearest_line_of_the_arm() -> None:
    found, furthest = reaching_out("at the goal", False)
    sphere = replace(in_the_way(found, furthest, np.zeros(3)), shape=Solid("sphere", [0.5]))
    another = Obstacle.sphere("nut", arm(found.problem.robot, found.q[0])[3], 0.1)
    depths = [
        max(0.0, one.radius - from_lines(arm(found.problem.robot, q), one.center).min())
        for q in found.q[::DENSE]
        for one in (sphere, another)
    ]
    assert np.count_nonzero(depths) > 3
    asked = replace(found, problem=replace(found.problem, obstacles=(sphere, another, FAR[0])))
    wanted = SETTINGS.penalty_gain * np.sum(np.array(depths) ** SETTINGS.penalty_exponent)
    assert asked.measured().penalty == pytest.approx(wanted, rel=1e-9)


@cache
def touching_angle() -> float:
    """The paper's arm leans on its chaser where its second joint is turned as far down."""
    high, low = -0.3, -1.4
    for _ in range(30):
        middle = (high + low) / 2
        high, low = (middle, low) if least_of_pairs(middle)[0] > 0.0 else (high, middle)
    return low


def least_of_pairs(angle: float) -> tuple[float, set[str]]:
    robot = lemur_with_bodies()
    q = pin.neutral(robot.model)
    q[7:] = upright()
    q[8] = angle
    places = body_placements(robot, q)
    found = [
        (
            coal_distance(robot.bodies[a].solid, places[a], robot.bodies[b].solid, places[b]),
            {robot.bodies[a].name, robot.bodies[b].name},
        )
        for a, b in robot.pairs
    ]
    return min(found, key=lambda each: each[0])


def upright() -> Array:
    return np.array([0.21886, -0.24260, 0.0, -1.13324, -1.83748, 1.14511, -2.23315])


@cache
def leaning(place: str, beyond: float) -> Made:
    """At one place alone the arm comes so far beyond where it touches the chaser [rad]."""
    way = touching_angle() - beyond - upright()[1]
    joints = resting(upright())
    if place in PLACES:
        joints = joints.bulging(1, PLACES[place], way)
    else:
        positions = joints.positions.copy()
        positions[AT_POINTS[place.split()[-1]], 1] += way
        joints = replace(joints, positions=positions)
    return made(lemur_with_bodies(), joints, np.zeros(6), PLACE)


@pytest.mark.sampled
@pytest.mark.law("PLAN-08")
@everywhere
def test_a_body_in_another_is_refused(place: str) -> None:
    _, names = least_of_pairs(touching_angle())
    kept = leaning(place, -0.01)
    assert not kept.judged()
    assert 0.0 < kept.plan.metrics.min_self_clearance < 0.02
    found = leaning(place, 0.01)
    failures = found.judged()
    the_one(failures, Status.COLLISION, " inside ", *names)
    assert set(found.plan.metrics.min_self_clearance_pair.split("/")) == names
    assert found.plan.metrics.min_self_clearance < -1e-4


@pytest.mark.parametrize("place", ["start", "at the goal", "end"])
def test_two_bodies_that_may_touch_at_the_goal_do_so_near_it_alone(place: str) -> None:
    _, names = least_of_pairs(touching_angle())
    first, second = sorted(name.split("#")[0] for name in names)
    found = leaning(place, 0.01)
    for allowed in (f"{first}/{second}", f"{second}/{first}"):
        assert not found.judged(allowed_collisions=(allowed,), contact_distance=9.0)
        failures = found.judged(allowed_collisions=(allowed,), contact_distance=0.01)
        assert failures, "it does not stay there"
    # Others than these two may: that does not help.
    others = next(
        pair for pair in pairs_of_links(found.problem.robot) if set(pair) != {first, second}
    )
    failures = found.judged(allowed_collisions=("/".join(others),), contact_distance=9.0)
    the_one(failures, Status.COLLISION, " inside ", *names)


def pairs_of_links(robot: Robot) -> list[tuple[str, str]]:
    return [(robot.bodies[a].link, robot.bodies[b].link) for a, b in robot.pairs]


def test_a_way_out_of_a_contact_stays_within_the_limits() -> None:
    """Of each joint that would lead out, once it is held, another one or none is told."""
    problem = leaning("start", 0.01).problem
    q = leaning("start", 0.01).q[DENSE // 2]
    told = set[str]()
    while True:
        contact = deepest_contact(problem, q)
        assert contact is not None
        words = way_out(problem, q, contact)
        if not words:
            break
        name = words.split()[1]
        assert name not in told
        told.add(name)
        joint, robot = problem.robot.joint_names.index(name), problem.robot
        upper, lower = robot.upper_position_limits.copy(), robot.lower_position_limits.copy()
        upper[joint], lower[joint] = q[7 + joint] + 0.01, q[7 + joint] - 0.01
        held = replace(robot, upper_position_limits=upper, lower_position_limits=lower)
        problem = replace(problem, robot=held)
    assert "joint_2" in told
