"""A goal that nothing can reach is refused before any search, and what can be reached is not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance, random_robot
from handmade_plans import SETTINGS, Made, made, resting
from published_paths import ATTITUDE, problem_along
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE, POSTURE, TWIST

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.problem.path.followed import PathPoint, PathToFollow, end_effector
from ff_planner_ros.planning.problem.problem import Obstacle, Orientation, PlanningProblem, Target
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

FAR = Obstacle.sphere("moon", PLACE + 30.0, 1.0)
UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])


def refusal_of(problem: PlanningProblem, status: Status) -> str:
    with pytest.raises(NoPlanFound) as refused:
        require_plannable(problem, SETTINGS)
    assert refused.value.status is status
    return str(refused.value)


@cache
def away_from_goal() -> Made:
    """Its end effector is half a metre from the goal when it begins."""
    joints = resting(POSTURE).stepping(0, 3, 0.8)
    return made(robot_from_urdf_text(*ROBOTS["six joints"]), joints, TWIST, PLACE)


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("drift", [np.zeros(3), np.array([0.3, -0.2, 0.1])])
def test_a_goal_inside_any_obstacle_when_the_plan_ends_is_refused(
    number: int, drift: Array
) -> None:
    problem = away_from_goal().problem
    # With an orientation the last line is known at the goal, and refused where it is in a sphere.
    problem = replace(problem, target=replace(problem.target, orientation=Orientation.FREE))
    goal, way = problem.target.position, problem.duration * drift
    aside = np.array([0.0, 0.03, 0.0])
    for depth in (1e-3, -1e-6):
        sphere = Obstacle.sphere("rock", goal + aside - way, 0.03 + depth, drift)
        others = [FAR, replace(FAR, id="sun")]
        asked = replace(problem, obstacles=(*others[:number], sphere, *others[number:]))
        if depth < 0.0:
            require_plannable(asked, SETTINGS)
            continue
        message = refusal_of(asked, Status.COLLISION)
        assert "target.position lies 0.0010 m inside obstacle rock" in message


def test_a_goal_that_an_obstacle_has_left_by_then_is_not_refused() -> None:
    problem = away_from_goal().problem
    leaving = Obstacle.sphere("rock", problem.target.position, 0.03, np.array([0.0, 0.5, 0.0]))
    require_plannable(replace(problem, obstacles=(leaving,)), SETTINGS)


def link(name: str, mass: float, lever: float) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="{lever} 0 0"/><mass value="{mass}"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def straight_arm(
    masses: tuple[float, ...], levers: tuple[float, ...], places: tuple[float, ...]
) -> Robot:
    """An arm that is stretched along x: four bodies, and where joints and tip follow."""
    parts, parent = [link("base", masses[0], levers[0])], "base"
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 0 1")):
        name = f"link_{k}"
        parts.append(link(name, masses[k + 1], levers[k + 1]))
        parts.append(
            f'<joint name="joint_{k}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{places[k]} 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" velocity="1" effort="100"/></joint>'
        )
        parent = name
    parts.append(
        '<link name="tip"/><joint name="end" type="fixed"><parent link="link_2"/>'
        f'<child link="tip"/><origin xyz="{places[3]} 0 0"/></joint>'
    )
    text = f'<robot name="straight">{"".join(parts)}</robot>'
    return robot_from_urdf_text(text, "base", "tip", geometry=Geometry.LINES)


LIGHT = 1e-4
STRAIGHT = {
    # All mass in one body, whose centre is behind where the arm goes on: the bound is exact.
    "chaser": ((100.0, LIGHT, LIGHT, LIGHT), (-0.7, 0.0, 0.0, 0.0), (0.5, 0.6, 0.4, 0.3), 2.5),
    "first link": ((LIGHT, 100.0, LIGHT, LIGHT), (0.0, -0.9, 0.0, 0.0), (0.2, 0.6, 0.4, 0.3), 2.2),
}


def center_of_mass(found: Made, time: float) -> Array:
    """Where the system's centre of mass will be, which drifts in a straight line."""
    model = found.problem.robot.model
    data = model.createData()
    pin.centerOfMass(model, data, found.q[0], found.v[0])
    return np.array(data.com[0] + time * data.vcom[0])


def asked_at(found: Made, way: Array) -> PlanningProblem:
    """The goal a way from where the system's centre of mass will be."""
    place = center_of_mass(found, found.problem.duration) + way
    target = Target(place, UNTURNED, orientation=Orientation.FREE)
    return replace(found.problem, target=target)


@pytest.mark.parametrize("name", STRAIGHT)
@pytest.mark.parametrize("drift", [0.0, 0.2, -0.2])
def test_the_reach_of_an_arm_that_is_all_known_is_exact(name: str, drift: float) -> None:
    """Wherever the centre of mass drifts, the goal may be as far from it as the arm is long."""
    masses, levers, places, reach = STRAIGHT[name]
    robot = straight_arm(masses, levers, places)
    # Bent: stretched, it would begin at the edge of its reach.
    joints, twist = resting(np.array([0.4, -0.3, 0.5])), np.array([0.0, drift, 0.1, 0.0, 0.0, 0.0])
    found = made(robot, joints, twist, PLACE, Rotation.from_rotvec([0.5, 1.0, -0.3]))
    for axis in (*np.eye(3), *-np.eye(3)):
        require_plannable(asked_at(found, 0.9999 * reach * axis), SETTINGS)
        message = refusal_of(asked_at(found, 1.0001 * reach * axis), Status.GOAL_OUT_OF_REACH)
        assert f"the arm reaches at most {reach:.3f} m" in message
        assert f"{1.0001 * reach:.3f} m from where the system's centre of mass" in message


def led_past(found: Made, ways: list[Array]) -> PlanningProblem:
    """A path from the end effector to these ways from the centre of mass, a second apart."""
    problem = found.problem
    begins = end_effector(problem.robot, problem.start)[0].translation
    places = [center_of_mass(found, k + 1.0) + way for k, way in enumerate(ways)]
    points = tuple(PathPoint(float(k), place) for k, place in enumerate([begins, *places]))
    return problem_along(problem.robot, problem.start, PathToFollow(points, ROOM, ROOM), ATTITUDE)


ROOM = 1e-3  # tolerance of a path [m, rad]


@pytest.mark.parametrize("drift", [0.0, 0.2, -0.2])
def test_a_path_may_be_as_far_from_the_centre_of_mass_as_the_arm_is_long(drift: float) -> None:
    """And by its tolerance further, at any of its points and at the time of that."""
    masses, levers, places, reach = STRAIGHT["chaser"]
    robot = straight_arm(masses, levers, places)
    joints, twist = resting(np.array([0.4, -0.3, 0.5])), np.array([0.0, drift, 0.1, 0.0, 0.0, 0.0])
    found = made(robot, joints, twist, PLACE, Rotation.from_rotvec([0.5, 1.0, -0.3]))
    near = np.array([1.0, 0.0, 0.0])
    for number, axis in enumerate((*np.eye(3), *-np.eye(3))):
        ways = [near] * 6
        ways[number] = (0.9999 * reach + ROOM) * axis
        require_plannable(led_past(found, ways), SETTINGS)
        ways[number] = (1.0001 * reach + ROOM) * axis
        message = refusal_of(led_past(found, ways), Status.GOAL_OUT_OF_REACH)
        assert message.startswith(f"target.path[{number + 1}].position is ")
        assert f"will be at t = {number + 1} s; the arm reaches at most {reach:.3f} m" in message


@pytest.mark.parametrize("drift", [np.zeros(3), np.array([0.3, -0.2, 0.1])])
def test_a_path_through_an_obstacle_is_refused_where_it_is_deeper_than_the_tolerance(
    drift: Array,
) -> None:
    masses, levers, places, _ = STRAIGHT["chaser"]
    robot = straight_arm(masses, levers, places)
    found = made(robot, resting(np.array([0.4, -0.3, 0.5])), np.zeros(6), PLACE)
    asked = led_past(found, [np.array([1.0, 0.3 * k, 0.0]) for k in range(4)])
    assert asked.path is not None
    at = asked.path.points[2].position - 2.0 * drift
    for depth in (2e-3, 0.9e-3):
        rock = Obstacle.sphere("rock", at + np.array([0.0, 0.0, 0.03]), 0.03 + depth, drift)
        passed = replace(asked, obstacles=(FAR, rock))
        if depth < ROOM:
            require_plannable(passed, SETTINGS)
            continue
        message = refusal_of(passed, Status.COLLISION)
        assert message == (
            "target.path[2].position lies 0.0020 m inside obstacle rock at t = 2 s: there the arm "
            "cannot be outside it"
        )


HEAVY = {
    # Far behind its joint: it brings the centre of mass to the other side of the arm.
    "second link": ((LIGHT, LIGHT, 100.0, LIGHT), (0.0, 0.0, -1.5, 0.0)),
    "third link": ((LIGHT, LIGHT, LIGHT, 100.0), (0.0, 0.0, 0.0, -2.5)),
    "every body": ((10.0, 5.0, 20.0, 30.0), (-0.8, -0.5, -1.0, -2.0)),
}


def furthest_reached(robot: Robot, rng: np.random.Generator, tries: int = 400) -> float:
    """The furthest that the tip was found from the centre of mass, climbing from posture on."""
    model, data = robot.model, robot.model.createData()

    def distance(angles: Array) -> float:
        q = np.concatenate([pin.neutral(model)[:7], angles])
        center = pin.centerOfMass(model, data, q)
        pin.forwardKinematics(model, data, q)
        tip = pin.updateFramePlacement(model, data, robot.tip_frame_id).translation
        return float(np.linalg.norm(tip - center))

    best = np.zeros(robot.joints)
    highest, spread = distance(best), 2.0
    for _ in range(tries):
        other = best + spread * rng.normal(size=robot.joints)
        if distance(other) > highest:
            best, highest = other, distance(other)
        else:
            spread = max(0.97 * spread, 0.02)
    return highest


def robot_of(name: str) -> Robot:
    if name in HEAVY:
        return straight_arm(*HEAVY[name], (0.2, 0.6, 0.4, 0.3))
    return robot_from_urdf_text(*ROBOTS[name])


@pytest.mark.parametrize("name", [*HEAVY, *ROBOTS])
def test_what_an_arm_reaches_is_not_refused_and_twice_as_far_is(name: str) -> None:
    rng, robot = np.random.default_rng(5), robot_of(name)
    found = made(robot, resting(np.linspace(-0.7, 1.1, robot.joints)), np.zeros(6), PLACE)
    way = rng.normal(size=3)
    way *= furthest_reached(robot, rng) / np.linalg.norm(way)
    require_plannable(asked_at(found, way), SETTINGS)
    refusal_of(asked_at(found, 2.0 * way), Status.GOAL_OUT_OF_REACH)


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("drift", [np.zeros(3), np.array([0.3, -0.2, 0.1])])
def test_a_tool_that_is_in_an_obstacle_at_the_goal_is_refused(number: int, drift: Array) -> None:
    """Of bodies that the last joint carries; where the obstacle is when the plan ends."""
    robot = random_robot(3)
    found = made(robot, resting(POSTURE).stepping(0, 3, 0.8), TWIST, PLACE)
    problem = replace(found.problem, robot=replace(found.problem.robot, pairs=()))
    center = problem.target.position + np.array([0.1, -0.4, 0.3])
    there = pin.SE3(np.eye(3), center)
    goal = found.q[found.time == problem.duration][0]
    last = max(body.joint for body in robot.bodies)
    distance, name = min(
        (coal_distance(body.solid, at, coal.Sphere(1e-9), there), body.name)
        for body, at in zip(robot.bodies, body_placements(robot, goal), strict=True)
        if body.joint == last
    )
    assert distance > 0.05
    for depth in (2e-3, -1e-4):
        start = center - problem.duration * drift
        sphere = Obstacle.sphere("rock", start, distance + depth, drift)
        others = [FAR, replace(FAR, id="sun")]
        asked = replace(problem, obstacles=(*others[:number], sphere, *others[number:]))
        if depth < 0.0:
            require_plannable(asked, SETTINGS)
            continue
        message = refusal_of(asked, Status.COLLISION)
        assert f"at the goal {name} is 0.0020 m inside obstacle rock" in message
        link = name.split("#")[0]
        assert f"{link}/rock in allowed_collisions" in message
        require_plannable(replace(asked, allowed_collisions=(f"{link}/rock",)), SETTINGS)
        free = replace(asked.target, orientation=Orientation.FREE)
        require_plannable(replace(asked, target=free), SETTINGS)
