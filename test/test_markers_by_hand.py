"""Markers of obstacles of every kind, against shapes and motions written out: type, size and pose.

How far a convex body extends along every direction says its size, place and attitude in one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import drawn_plan
from scipy.spatial.transform import Rotation
from shaped_problems import SOLIDS, with_fixed_bodies
from test_tumbling import body_of, moved
from visualization_msgs.msg import Marker

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, with_capture_target
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.ros.outputs.markers import SNAPSHOTS, plan_markers

BALL = 0.3
TYPES = {"ball": Marker.SPHERE, "box": Marker.CUBE}  # the others are triangles
ROUND = 0.01  # of a radius: 24 corners lie inside a circle by 0.9 % at most
AWAY = np.array([2.0, 0.0, 0.0])
WAYS = np.random.default_rng(3).normal(size=(500, 3))
WAYS /= np.linalg.norm(WAYS, axis=1)[:, None]


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    """Bodies of every kind that move and turn, and the same fixed to a tumbling target."""
    drawn = tumbling.problem("tumbling", 0)
    rng = np.random.default_rng(2)
    free = [
        Obstacle(
            kind,
            solid,
            RigidMotion(
                rng.normal(size=3),
                Rotation.random(random_state=number).as_quat(),
                rng.normal(scale=0.1, size=3),
                rng.normal(scale=0.1, size=3),
            ),
        )
        for number, (kind, solid) in enumerate(SOLIDS.items())
    ]
    ball = Obstacle.sphere("ball", np.array([1.0, -2.0, 3.0]), BALL, np.array([0.1, 0.0, 0.0]))
    body = with_fixed_bodies(replace(body_of(drawn), obstacles=()), 2.0)
    held = AttachedObstacle.sphere("fixed_ball", AWAY, BALL)
    body = replace(body, obstacles=(*body.obstacles, held))
    return with_capture_target(body, replace(drawn, obstacles=(*free, ball)))


@pytest.fixture(scope="module")
def plan(problem: PlanningProblem) -> Plan:
    return drawn_plan(problem.robot, seed=2)


@pytest.fixture(scope="module")
def markers(problem: PlanningProblem, plan: Plan) -> Mapping[str, list[Marker]]:
    drawn = plan_markers(problem.robot, plan, scene_of(problem), "inertial").markers
    names = ("obstacles", "obstacle_path", "target_body")
    return {name: [one for one in drawn if one.ns == name] for name in names}


def extents(kind: str, place: Array, turn: Rotation) -> Array:
    """How far a body of a kind extends along `WAYS`, by textbook formulas."""
    across = turn.inv().apply(WAYS)
    up, rim = np.abs(across[:, 2]), np.hypot(across[:, 0], across[:, 1])
    match kind:
        case "ball":
            own = np.full(len(WAYS), BALL)
        case "box":
            own = np.abs(across) @ [0.15, 0.2, 0.0025]
        case "cylinder":
            own = 0.35 * up + 0.1 * rim
        case "capsule":
            own = 0.15 * up + 0.05
        case "cone":
            own = np.maximum(0.15 * across[:, 2], 0.2 * rim - 0.15 * across[:, 2])
        case _:  # the fifth vertex of the mesh is inside
            corners = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
            own = (across @ corners.T).max(axis=1)
    return np.asarray(WAYS @ place + own)


def extents_drawn(marker: Marker) -> Array:
    """How far what a viewer draws extends along `WAYS`, as ROS defines the types of markers."""
    at, turned, size = marker.pose.position, marker.pose.orientation, marker.scale
    across = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).inv().apply(WAYS)
    edges = np.array([size.x, size.y, size.z])
    match marker.type:
        case Marker.SPHERE:
            own = np.linalg.norm(across * edges / 2.0, axis=1)
        case Marker.CUBE:
            own = np.abs(across) @ edges / 2.0
        case Marker.TRIANGLE_LIST:
            corners = np.array([[point.x, point.y, point.z] for point in marker.points])
            own = (across @ (corners * edges).T).max(axis=1)
        case _:
            pytest.fail(f"type {marker.type}")
    return np.asarray(WAYS @ [at.x, at.y, at.z] + own)


def check(marker: Marker, kind: str, place: Array, turn: Rotation) -> None:
    assert marker.type == TYPES.get(kind, Marker.TRIANGLE_LIST), kind
    lacking = extents(kind, place, turn) - extents_drawn(marker)
    assert lacking.min() > -1e-9, kind
    is_round = kind in ("cylinder", "capsule", "cone")
    assert lacking.max() < (ROUND * 0.2 if is_round else 1e-9), kind


def test_free_obstacles_are_drawn_where_they_are_at_the_first_point(
    problem: PlanningProblem, markers: Mapping[str, list[Marker]]
) -> None:
    free = [one for one in problem.obstacles if one.body is None]
    assert {one.id for one in free} == {*SOLIDS, "ball"}
    for marker, one in zip(markers["obstacles"], free, strict=True):
        if one.is_sphere:
            check(marker, one.id, one.center, Rotation.identity())
        else:
            check(
                marker,
                one.id,
                one.motion.position,
                Rotation.from_quat(one.motion.quaternion_xyzw.copy()),
            )


def test_the_paths_of_free_obstacles_end_where_their_velocities_lead(
    problem: PlanningProblem, plan: Plan, markers: Mapping[str, list[Marker]]
) -> None:
    free = [one for one in problem.obstacles if one.body is None]
    for marker, one in zip(markers["obstacle_path"], free, strict=True):
        begin = one.center if one.is_sphere else one.motion.position
        wanted = [begin, begin + plan.trajectory.time[-1] * one.motion.velocity]
        found = [[point.x, point.y, point.z] for point in marker.points]
        assert np.array(found) == pytest.approx(np.array(wanted))


def test_what_is_fixed_to_a_tumbling_target_moves_with_it(
    problem: PlanningProblem, plan: Plan, markers: Mapping[str, list[Marker]]
) -> None:
    body, times = body_of(problem), plan.trajectory.time
    fixed = body.obstacles
    assert {one.id for one in fixed} == {f"fixed_{kind}" for kind in (*SOLIDS, "ball")}
    shown = np.linspace(0, len(times) - 1, SNAPSHOTS).round().astype(int)
    centers, attitudes, _ = moved(body, times[shown])
    assert (attitudes[0].inv() * attitudes[-1]).magnitude() > 0.1  # it does tumble
    drawn = iter(markers["target_body"])
    for center, attitude in zip(centers, attitudes, strict=True):
        for one in fixed:
            own = Rotation.from_quat(one.quaternion_xyzw.copy())
            where = center + attitude.apply(one.position.copy())
            check(next(drawn), one.id.removeprefix("fixed_"), where, attitude * own)
    assert not list(drawn)
