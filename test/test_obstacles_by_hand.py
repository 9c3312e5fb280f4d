"""Obstacles of any shape that a hand-made plan touches, at any place and time, are told by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance
from handmade_plans import DENSE, PLACES, SETTINGS, Made, arm
from test_clearance_by_hand import FAR, reaching_out
from test_limits_by_hand import the_one
from test_starts_refused import refusal_of

from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.distance.contact import deepest_contact, tool_contact
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.problems import bodies
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.configuration import configuration

# Of each, its thinnest half along its x axis is 0.1 m.
SOLIDS = {
    "box": Solid("box", np.array([0.2, 0.3, 0.4])),
    "cylinder": Solid("cylinder", np.array([0.1, 0.4])),
    "capsule": Solid("capsule", np.array([0.1, 0.4])),
    "cone": Solid("cone", np.array([0.1, 0.4])),
    "mesh": hull_of_vertices(
        "vertices",
        np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (0, 0.3)]),
    ),
}
MOTIONS = ("at rest", "moving", "turning")
every_shape = pytest.mark.parametrize("kind", SOLIDS)
as_they_come = pytest.mark.parametrize("motion", MOTIONS)


def in_the_way(found: Made, furthest: int, kind: str, motion: str, beyond: float) -> Obstacle:
    """A solid that is so far from the end effector when the arm is furthest aside [m]."""
    time, q = found.time[furthest], found.q[furthest]
    there = arm(found.problem.robot, q)[-1]
    aside = there - arm(found.problem.robot, found.q[0])[-1]
    aside /= np.linalg.norm(aside)
    turn = pin.Quaternion.FromTwoVectors(np.array([1.0, 0.0, 0.0]), aside).toRotationMatrix()
    solid = SOLIDS[kind]
    # Moved along the way aside until Coal has the distance from all bodies or lines that is asked.
    places = body_placements(found.problem.robot, q)

    def distance(at: float) -> float:
        place = pin.SE3(turn, there + at * aside)
        return min(
            coal_distance(body.solid, where, solid.geometry, place)
            for body, where in zip(found.problem.robot.bodies, places, strict=True)
        )

    near, far = -0.5, 3.0
    for _ in range(60):
        middle = (near + far) / 2
        near, far = (middle, far) if distance(middle) < beyond else (near, middle)
    velocity = np.array([0.02, -0.03, 0.01]) * (motion == "moving")
    rate = 0.3 * aside * (motion == "turning")
    begin = pin.exp3(-time * rate) @ turn
    place = there + far * aside - time * velocity
    return Obstacle(
        "panel", solid, RigidMotion(place, pin.Quaternion(begin).coeffs(), velocity, rate)
    )


@pytest.mark.sampled
@pytest.mark.law("PLAN-07")
@as_they_come
@every_shape
@pytest.mark.parametrize("place", PLACES)
def test_a_body_in_an_obstacle_is_refused_wherever_and_however_it_comes(
    place: str, kind: str, motion: str
) -> None:
    found, furthest = reaching_out(place, True)
    for beyond in (0.004, -0.004):
        panel = in_the_way(found, furthest, kind, motion, beyond)
        asked = replace(found, problem=replace(found.problem, obstacles=(FAR[0], panel, FAR[1])))
        failures = [failure for failure in asked.judged() if failure.status is Status.COLLISION]
        told = [failure for failure in failures if "panel" in failure.finding]
        metrics = asked.measured()
        if beyond > 0.0:
            assert not told, (place, kind, motion)
        else:
            (one,) = told
            assert " inside obstacle panel at " in one.finding
            assert metrics.min_clearance < -1e-3
            assert metrics.min_clearance_pair.endswith("/panel")
            assert metrics.min_clearance_time == pytest.approx(
                found.time[furthest], abs=found.time[DENSE]
            )


@pytest.mark.law("PLAN-07")
def test_lines_are_kept_clear_of_shapes_too() -> None:
    found, furthest = reaching_out(next(iter(PLACES)), False)
    tip = arm(found.problem.robot, found.q[furthest])[-1]
    panel = Obstacle("panel", SOLIDS["box"], RigidMotion(tip))
    asked = replace(found, problem=replace(found.problem, obstacles=(panel,)))
    the_one(asked.judged(), Status.COLLISION, " inside obstacle panel")
    assert asked.measured().min_clearance_pair.endswith("/panel")
    away = panel.with_motion(position=tip + 50.0)
    kept = replace(found, problem=replace(found.problem, obstacles=(away,)))
    assert not kept.judged()


def test_a_start_in_an_obstacle_is_refused_by_name_and_depth() -> None:
    found, _ = reaching_out(next(iter(PLACES)), True)
    q = found.q[0]
    body, place = found.problem.robot.bodies[-1], body_placements(found.problem.robot, q)[-1]
    ball = Solid("cone", np.array([0.3, 0.3]))
    panel = Obstacle("panel", ball, RigidMotion(place.translation))
    refused = refusal_of(
        replace(found.problem, obstacles=(FAR[0], panel)), Status.START_IN_COLLISION
    )
    assert refused.startswith("obstacles[panel] is around ")
    depth = coal_distance(body.solid, place, ball.geometry, pin.SE3(np.eye(3), place.translation))
    assert depth < 0.0
    assert " m deep" in refused


def test_a_goal_whose_tool_is_in_an_obstacle_is_refused_unless_it_is_what_is_grasped() -> None:
    problem = bodies.problem("arm6", 0).problem
    goal = problem.target.position
    wall = Obstacle("wall", Solid("box", np.full(3, 0.1)), RigidMotion(goal))
    walled = replace(problem, obstacles=(*problem.obstacles, wall))
    contact = tool_contact(walled)
    assert contact is not None
    assert contact.second == "wall"
    with pytest.raises(NoPlanFound, match="inside obstacle wall, in any posture"):
        require_plannable(walled, SETTINGS)
    links = {body.link for body in problem.robot.bodies if body.joint == problem.robot.joints + 1}
    named = tuple(f"{link}/wall" for link in links)
    require_plannable(replace(walled, allowed_collisions=named), SETTINGS)
    with pytest.raises(InvalidInput, match="it must be link/obstacle or link/link"):
        replace(walled, allowed_collisions=("link_1/door",))


def test_what_is_grasped_may_be_touched_near_the_goal_and_nowhere_else() -> None:
    """A wall at the goal: the plan ends in it, and keeps clear of all others."""
    problem = bodies.problem("arm6", 0).problem
    robot, target = problem.robot, problem.target
    tool = [body for body in robot.bodies if body.joint == robot.joints + 1]
    wall = Obstacle("wall", Solid("box", np.full(3, 0.04)), RigidMotion(target.position))
    named = tuple(f"{body.link}/wall" for body in tool)
    found = plan(
        replace(problem, obstacles=(*problem.obstacles, wall), allowed_collisions=named), SETTINGS
    )
    assert found.metrics.min_clearance >= 0.0
    goal = pin.SE3(pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(), target.position)
    last_joint = goal * robot.model.frames[robot.tip_frame_id].placement.inverse()
    at = pin.SE3(np.eye(3), wall.motion.position)
    depths = [
        coal_distance(body.solid, last_joint * body.placement_in_joint, wall.solid.geometry, at)
        for body in tool
    ]
    assert min(depths) < 0.0
    q = configuration(robot, problem.start)[0]
    at_goal = from_trajectory(robot, found.trajectory)[0][-1]
    touched = deepest_contact(replace(problem, obstacles=(wall,)), at_goal, problem.duration)
    assert touched is not None
    assert touched.second == "wall"
    may = replace(problem, obstacles=(wall,), allowed_collisions=named)
    assert deepest_contact(may, at_goal, problem.duration) is None
    away = wall.with_motion(position=body_placements(robot, q)[-1].translation)
    # From another start: what touches at the start is let go of there.
    begin = replace(problem.start, joint_positions=problem.start.joint_positions + 0.5)
    elsewhere = deepest_contact(replace(may, obstacles=(away,), start=begin), q)
    assert elsewhere is not None


def test_a_body_that_turns_further_than_anybody_can_foretell_is_refused_by_name() -> None:
    problem = bodies.problem("arm6", 0).problem
    rate = 999.0 / problem.duration
    panel = Obstacle(
        "panel", SOLIDS["box"], RigidMotion(np.full(3, 50.0), angular_velocity=[0, 0, rate])
    )
    replace(problem, obstacles=(panel,))
    with pytest.raises(InvalidInput, match=r"obstacles\[panel\].angular_velocity is .*too far"):
        replace(problem, obstacles=(panel.with_motion(angular_velocity=[0, 1.01 * rate, 0]),))
