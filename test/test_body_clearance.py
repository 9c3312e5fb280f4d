"""Plans of a robot with bodies: what they promise against what Coal finds between their points."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import (
    body_placements,
    coal_distance,
    lemur_with_bodies,
    random_robot,
    tumbling_spheres,
)
from dense_motion import truth
from near_bodies import least_distance
from robots import LEMUR_SCENARIO, random_state

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP, least_pair_distance
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.contact import deepest_contact
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.paths.spline_guesses import spline_guesses
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    Parametrisation,
    PlanningProblem,
    attached,
)
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.from_messages import problem_from_request
from ff_planner_ros.ros.messages.to_messages import request_message

SETTINGS = load_parameters().planner


@cache
def capture() -> PlanningProblem:
    return replace(load_scenario(LEMUR_SCENARIO), robot=lemur_with_bodies())


@cache
def solved(parametrisation: Parametrisation) -> Plan:
    return plan(replace(capture(), parametrisation=parametrisation), SETTINGS)


def dense_least(
    robot: Robot, q: Array, times: Array, spheres: tuple[Obstacle, ...]
) -> tuple[float, float]:
    """The least distances that Coal finds at many configurations: of spheres, and of pairs."""
    of_spheres, of_pairs = np.inf, np.inf
    for at, time in zip(q, times, strict=True):
        places = body_placements(robot, at)
        solids = [body.solid for body in robot.bodies]
        centers = centers_of(robot, places)
        for sphere in spheres:
            ball = coal.Sphere(sphere.radius)
            there = pin.SE3(np.eye(3), sphere.center + sphere.motion.way(float(time)))
            apart = np.linalg.norm(centers - there.translation, axis=1) - sphere.radius
            for number, body in enumerate(robot.bodies):
                if apart[number] - body.radius < of_spheres:
                    distance = coal_distance(body.solid, places[number], ball, there)
                    of_spheres = min(of_spheres, distance)
        for a, b in robot.pairs:
            around = robot.bodies[a].radius + robot.bodies[b].radius
            if np.linalg.norm(centers[a] - centers[b]) - around < of_pairs:
                of_pairs = min(of_pairs, coal_distance(solids[a], places[a], solids[b], places[b]))
    return of_spheres, of_pairs


def centers_of(robot: Robot, places: list[pin.SE3]) -> Array:
    """Where the spheres around the bodies are."""
    return np.array(
        [
            place.act(body.placement_in_joint.actInv(body.center_in_joint))
            for body, place in zip(robot.bodies, places, strict=True)
        ]
    )


@pytest.mark.law("PLAN-08")
@pytest.mark.parametrize("family", list(Parametrisation)[1:])
def test_no_body_touches_anything_between_the_points_of_a_plan(family: Parametrisation) -> None:
    problem, answer = capture(), solved(family)
    dense = truth(problem, answer.trajectory)
    of_spheres, of_pairs = dense_least(problem.robot, dense.q, dense.time, problem.obstacles)
    metrics = answer.metrics
    assert 0.0 <= metrics.min_clearance <= of_spheres + 1e-6
    assert 0.0 <= metrics.min_self_clearance <= of_pairs + 1e-6
    # Found on 400 configurations, the least is not the very least.
    assert metrics.min_clearance == pytest.approx(of_spheres, abs=3e-3)
    assert metrics.min_self_clearance == pytest.approx(of_pairs, abs=3e-3)


def test_the_pair_and_the_time_of_the_least_clearances_are_told() -> None:
    problem, answer = capture(), solved(Parametrisation.END_EFFECTOR_POLYNOMIAL)
    robot, metrics = problem.robot, answer.metrics
    dense = truth(problem, answer.trajectory)
    names = [body.name for body in robot.bodies]

    def at(time: float) -> list[pin.SE3]:
        return body_placements(robot, dense.q[np.abs(dense.time - time).argmin()])

    body, sphere = metrics.min_clearance_pair.split("/")
    (ball,) = (one for one in problem.obstacles if one.id == sphere)
    place = at(metrics.min_clearance_time)[names.index(body)]
    there = pin.SE3(np.eye(3), ball.center)
    solid = robot.bodies[names.index(body)].solid
    found = coal_distance(solid, place, coal.Sphere(ball.radius), there)
    assert found == pytest.approx(metrics.min_clearance, abs=3e-3)
    first, second = (names.index(name) for name in metrics.min_self_clearance_pair.split("/"))
    places = at(metrics.min_self_clearance_time)
    solids = robot.bodies[first].solid, robot.bodies[second].solid
    found = coal_distance(solids[0], places[first], solids[1], places[second])
    assert found == pytest.approx(metrics.min_self_clearance, abs=3e-3)


def random_motion(robot: Robot, seed: int, points: int) -> FollowedMotion:
    """A motion through random joint angles; the chaser drifts and tumbles."""
    rng = np.random.default_rng(seed)
    q, v = configuration(robot, random_state(robot, rng))
    shape = points, robot.joints
    way = JointMotion(
        np.linspace(0.0, 4.0, points),
        np.cumsum(np.vstack([q[7:], rng.normal(scale=0.2, size=shape)[1:]]), axis=0),
        np.vstack([v[6:], rng.normal(scale=0.1, size=shape)[1:]]),
        rng.normal(scale=0.1, size=shape),
    )
    # So finely that the cubics from step to step are as good as the motion.
    return followed(robot, q, v, way, multiple=16)


def certified(robot: Robot, motion: FollowedMotion, spheres: tuple[Obstacle, ...]) -> list[Least]:
    last, every = len(motion.time) - 1, len(robot.bodies) * len(spheres)
    return [
        least_distance(robot, motion, spheres, np.arange(every), last),
        least_pair_distance(robot, motion, np.arange(len(robot.pairs)), last),
    ]


@pytest.mark.law("PLAN-09")
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 40])
def test_the_certificate_is_below_what_is_found_between_the_points_and_hardly_so(seed: int) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    motion = random_motion(robot, seed, points=(4, 40)[seed % 2])
    # Spheres on the way, and such that all bodies stay clear of them.
    spheres = tuple(
        Obstacle.sphere(
            str(k), motion.q[rng.integers(len(motion.q)), :3] + rng.normal(size=3), 0.1, drift
        )
        for k, drift in enumerate(rng.normal(scale=0.05, size=(5, 3)))
    )
    found = certified(robot, motion, spheres)
    fine = np.linspace(0.0, motion.time[-1], 4 * len(motion.time))
    finer = followed(robot, motion.q[0], motion.v[0], motion.joints, multiple=32)
    fine, q = finer.time, finer.q
    for least, dense in zip(found, dense_least(robot, q, fine, spheres), strict=True):
        assert least.certified <= least.found <= least.certified + CHECK_GAP
        assert least.certified <= dense + 2e-5, f"seed {seed}: {least}, Coal {dense}"
        if dense > -0.05:  # deep inside, the depth has kinks that no sampling finds
            assert least.found >= dense - 3e-3, f"seed {seed}: {least}, Coal {dense}"


@pytest.mark.parametrize("seed", range(5, 13))
def test_the_certificate_holds_where_spheres_are_fixed_to_a_body_that_tumbles(seed: int) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    motion = random_motion(robot, seed, points=(4, 40)[seed % 2])
    spheres = tumbling_spheres(rng, motion.q[len(motion.q) // 2, :3], 4)
    every = np.arange(len(robot.bodies) * len(spheres))
    least = least_distance(robot, motion, spheres, every, len(motion.time) - 1)
    finer = followed(robot, motion.q[0], motion.v[0], motion.joints, multiple=32)
    dense, _ = dense_least(replace(robot, pairs=()), finer.q, finer.time, spheres)
    assert least.certified <= least.found <= least.certified + CHECK_GAP
    assert least.certified <= dense + 2e-5, f"seed {seed}: {least}, Coal {dense}"
    if dense > -0.05:
        assert least.found >= dense - 3e-3, f"seed {seed}: {least}, Coal {dense}"


def test_a_sphere_that_swings_by_a_resting_robot_is_not_overlooked() -> None:
    """It comes by between the configurations that are looked at first."""
    robot = random_robot(5)
    rest = np.zeros((4, robot.joints))
    q = configuration(robot, random_state(robot, np.random.default_rng(5)))[0]
    joints = JointMotion(np.linspace(0.0, 4.0, 4), rest + q[7:], rest, rest)
    motion = followed(robot, q, np.zeros(robot.model.nv), joints)
    body = TargetBody(
        position=q[:3] + np.array([3.0, 0.0, 0.0]),
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.eye(3),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        angular_velocity=[0.0, 0.0, 20.0],
        obstacles=(AttachedObstacle.sphere("boom", [0.0, 2.5, 0.0], 0.1),),
    )
    spheres = tuple(attached(body))
    every = np.arange(len(robot.bodies))
    least = least_distance(robot, motion, spheres, every, len(motion.time) - 1)
    times = np.linspace(0.0, 4.0, 2000)
    still = replace(robot, pairs=())
    dense, _ = dense_least(still, np.tile(q, (len(times), 1)), times, spheres)
    assert least.certified <= dense
    assert least.found == pytest.approx(dense, abs=0.01)


def leaning(angle: float) -> PlanningProblem:
    """The capture from a start whose upper arm is turned down to the chaser."""
    problem = capture()
    joints = problem.start.joint_positions.copy()
    joints[1] = angle
    return replace(
        problem, start=replace(problem.start, joint_positions=joints, joint_velocities=0.0 * joints)
    )


# The upper arm through a panel: out of it is where the depth grows at first.
DEEP = (1.5, -2.0, 2.5, 2.1, 2.6, 2.8, 1.8)


@pytest.mark.parametrize("joints", [None, DEEP])
def test_a_start_in_contact_with_itself_is_refused_and_the_way_out_is_right(
    joints: tuple[float, ...] | None,
) -> None:
    problem = replace(leaning(np.deg2rad(-80.0)), obstacles=())
    if joints is not None:
        start = replace(problem.start, joint_positions=np.array(joints))
        problem = replace(problem, start=start)
    with pytest.raises(InvalidInput, match=r"m deep.*turned by") as refused:
        require_plannable(problem, SETTINGS)
    assert refused.value.status is Status.START_IN_COLLISION
    message = str(refused.value)
    q = configuration(problem.robot, problem.start)[0].copy()
    depth = -dense_least(problem.robot, q[None], np.zeros(1), ())[1]
    assert f"{depth:.4f} m deep" in message
    joint, turn = message.split("; ")[1].split(" turned by ")
    way = problem.robot.joint_names.index(joint)
    q[7 + way] += np.deg2rad(float(turn.split()[0]))
    assert dense_least(problem.robot, q[None], np.zeros(1), ())[1] > 0.0


def test_a_start_inside_an_obstacle_is_refused_with_the_body_and_the_depth() -> None:
    problem = capture()
    q, _ = configuration(problem.robot, problem.start)
    panel = body_placements(problem.robot, q)[1]
    sphere = Obstacle.sphere("debris", panel.act(np.array([0.1, 0.4, 0.1])), 0.2)
    with pytest.raises(
        InvalidInput, match=r"obstacles\[debris\] is around chaser#2, 0.1200 m deep"
    ):
        require_plannable(replace(problem, obstacles=(sphere,)), SETTINGS)


def test_a_tool_inside_an_obstacle_at_the_goal_is_refused_at_once() -> None:
    problem = capture()
    sphere = Obstacle.sphere("grapple", problem.target.position, 0.12)
    touching = replace(problem, obstacles=(sphere,))
    with pytest.raises(NoPlanFound, match="link_7") as refused:
        require_plannable(touching, SETTINGS)
    assert refused.value.status is Status.COLLISION
    assert "allowed_collisions" in str(refused.value)


def grasping() -> PlanningProblem:
    """The capture of a fixture that the tool reaches into."""
    problem = capture()
    attitude = pin.Quaternion(problem.target.quaternion_xyzw).toRotationMatrix()
    fixture = Obstacle.sphere("fixture", problem.target.position + attitude @ [0.0, 0.0, 0.2], 0.08)
    return replace(
        problem,
        obstacles=(*problem.obstacles, fixture),
        allowed_collisions=("link_7/fixture",),
        contact_distance=0.25,
    )


def test_what_is_allowed_at_the_goal_touches_near_it_alone() -> None:
    problem = grasping()
    require_plannable(problem, SETTINGS)
    answer = plan(problem, SETTINGS)
    dense = truth(problem, answer.trajectory)
    robot, fixture = problem.robot, problem.obstacles[-1]
    ball, there = coal.Sphere(fixture.radius), pin.SE3(np.eye(3), fixture.center)
    data, touched = robot.model.createData(), 0
    for q in dense.q:
        pin.forwardKinematics(robot.model, data, q)
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
        is_near = np.linalg.norm(tip.translation - problem.target.position) < 0.25
        places = body_placements(robot, q)
        for body, place, center in zip(
            robot.bodies, places, centers_of(robot, places), strict=True
        ):
            if np.linalg.norm(center - there.translation) > body.radius + fixture.radius:
                continue
            distance = coal_distance(body.solid, place, ball, there)
            allowed = is_near and f"{body.link}/fixture" in problem.allowed_collisions
            assert distance >= -1e-6 or allowed, body.name
            touched += distance < 0.0
    assert touched > 5
    assert answer.metrics.min_clearance >= 0.0
    with pytest.raises(NoPlanFound, match="link_7/fixture in allowed_collisions"):
        require_plannable(replace(problem, allowed_collisions=("link_5/fixture",)), SETTINGS)


@pytest.mark.parametrize(
    "name", ["link_7/moon", "gripper/c1", "link_7", "c1/link_7", "link_6/link_7"]
)
def test_a_contact_of_what_there_is_not_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput, match=r"^allowed_collisions\.pairs is") as refused:
        replace(capture(), allowed_collisions=(name,))
    assert refused.value.status is Status.OUT_OF_RANGE
    assert name in str(refused.value)


def test_allowed_contacts_are_part_of_the_task_and_of_its_scenario(tmp_path: Path) -> None:
    robot = lemur_with_bodies()
    plain = capture()
    named = ("link_7/c1", "chaser/link_7")
    asked = replace(plain, allowed_collisions=named, contact_distance=0.3)
    digests = {
        PlanningTask(problem, SETTINGS).digest
        for problem in (plain, asked, replace(asked, contact_distance=0.2))
    }
    assert len(digests) == 3
    # In whatever order they are named.
    again = replace(asked, allowed_collisions=named[::-1])
    assert PlanningTask(again, SETTINGS).digest == PlanningTask(asked, SETTINGS).digest
    request = request_message(asked, "inertial")
    read = problem_from_request(request, robot, asked.start, asked.obstacles, load_parameters())
    assert (read.allowed_collisions, read.contact_distance) == (asked.allowed_collisions, 0.3)
    write_scenario(PlanningTask(asked, SETTINGS), tmp_path / "asked.yaml")
    scenario = load_scenario(tmp_path / "asked.yaml")
    assert scenario.allowed_collisions == asked.allowed_collisions
    assert scenario.contact_distance == 0.3


def test_a_goal_in_contact_in_one_posture_is_planned_to_another() -> None:
    problem = replace(
        capture(), parametrisation=Parametrisation.JOINT_SPLINE, obstacles=capture().obstacles[:1]
    )
    q, _ = configuration(problem.robot, problem.start)
    # Where the elbow would be at the goal: the arm has a joint to spare, and another place for it.
    first = next(spline_guesses(joint_splines(problem, SETTINGS), problem.obstacles, 13))
    way = joint_splines(problem, SETTINGS).motion(first, 13).q
    elbow = arm_points(problem.robot, way[-1:])[0, 3]
    blocked = replace(
        problem,
        obstacles=(
            *problem.obstacles,
            Obstacle.sphere("mast", elbow + np.array([0.0, 0.0, 0.15]), 0.12),
        ),
    )
    contact = deepest_contact(blocked, way[-1], blocked.duration)
    assert contact is not None
    assert contact.second == "mast"
    assert deepest_contact(blocked, q) is None
    family = joint_splines(blocked, SETTINGS)
    first = next(spline_guesses(family, blocked.obstacles, 13))
    assert deepest_contact(blocked, family.motion(first, 13).q[-1], blocked.duration) is None
    assert plan(blocked, SETTINGS).metrics.min_clearance >= 0.0
