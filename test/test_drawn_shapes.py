"""Bodies in the way as they are drawn, measured and told: figures, scenes, markers and reports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from drawn_plans import drawn_plan
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from shaped_problems import SOLIDS, capture_among_bodies, with_fixed_bodies
from test_solids import volume
from test_tumbling import body_of
from visualization_msgs.msg import Marker

from ff_planner_benchmark.bench.touching import touching
from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.analysis import nearest as nearest_bodies
from ff_planner_ros.analysis.drawing.capture_view import capture_figure
from ff_planner_ros.analysis.drawing.from_above import view_from_above
from ff_planner_ros.analysis.drawing.obstacle_surfaces import obstacle_surface, placed
from ff_planner_ros.analysis.drawing.scene import scene_figure
from ff_planner_ros.analysis.extremes import _between_points, distances, nearest
from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, with_capture_target
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.report.plan_words import obstacle_table
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.outputs.markers import SNAPSHOTS, plan_markers
from ff_planner_ros.runs.offline_bag import record_answer

FRAME = "inertial"
VOLUMES = {
    "box": 0.3 * 0.4 * 0.005,
    "cylinder": np.pi * 0.1**2 * 0.7,
    "capsule": np.pi * 0.05**2 * 0.3 + 4.0 / 3.0 * np.pi * 0.05**3,
    "cone": np.pi * 0.2**2 * 0.3 / 3.0,
    "mesh": float(ConvexHull(SOLIDS["mesh"].corners).volume),
}


@pytest.fixture(scope="module", params=[Geometry.LINES, Geometry.SHAPES])
def robot(request: pytest.FixtureRequest) -> Robot:
    return bench_robot("lemur", request.param)


@pytest.mark.parametrize("kind", SOLIDS)
def test_the_surface_of_a_body_is_closed_and_looks_outwards(kind: str) -> None:
    body = Obstacle(kind, SOLIDS[kind], RigidMotion(np.zeros(3)))
    corners, triangles = obstacle_surface(body, 200)
    assert volume(corners, triangles) == pytest.approx(VOLUMES[kind], rel=2e-3)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    around = {tuple(edge) for edge in corners[edges].round(9).reshape(-1, 6).tolist()}
    assert {(*edge[3:], *edge[:3]) for edge in around} == around, "each edge has two sides"


def test_a_body_is_drawn_where_it_is_and_as_it_is_turned() -> None:
    body = Obstacle(
        "panel",
        SOLIDS["box"],
        RigidMotion(
            np.array([1.0, 2.0, 3.0]),
            velocity=np.array([0.1, 0.0, 0.0]),
            angular_velocity=np.array([0.0, 0.0, np.pi / 20.0]),
        ),
    )
    begin, end = placed(body, np.array([[0.15, 0.0, 0.0]]), np.array([0.0, 10.0]))[:, 0]
    assert begin == pytest.approx([1.15, 2.0, 3.0])
    assert end == pytest.approx([2.0, 2.15, 3.0])


def moving_bodies(plan: Plan) -> tuple[Obstacle, ...]:
    """Bodies of every kind about the end effector, behind and before spheres."""
    place = plan.trajectory.ee_positions.mean(axis=0)
    rng = np.random.default_rng(5)
    found: list[Obstacle] = [
        Obstacle(
            kind,
            solid,
            RigidMotion(
                place + rng.normal(scale=0.5, size=3),
                Rotation.random(random_state=number).as_quat(),
                rng.normal(scale=0.05, size=3),
                rng.normal(scale=0.1, size=3),
            ),
        )
        for number, (kind, solid) in enumerate(SOLIDS.items())
    ]
    found.insert(2, Obstacle.sphere("ball", place + np.array([0.4, 0.0, 0.3]), 0.1))
    return tuple(found)


def _by_coal(robot: Robot, one: Obstacle, q: Array, time: float) -> float:
    """The least distance of the robot's bodies from an obstacle."""
    whole, data = with_bodies(robot), robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    if one.is_sphere:
        solid, place = (
            coal.Sphere(one.radius),
            pin.SE3(np.eye(3), one.center + one.motion.way(time)),
        )
    else:
        rotations, origins = one.motion.poses(np.array([time]))
        solid, place = one.solid.geometry, pin.SE3(rotations[0], origins[0])
    least = np.inf
    for body in whole.bodies:
        at = data.oMi[body.joint] * body.placement_in_joint
        result = coal.DistanceResult()
        least = min(
            least,
            coal.distance(
                body.solid,
                coal.Transform3s(at.rotation, at.translation),
                solid,
                coal.Transform3s(place.rotation, place.translation),
                coal.DistanceRequest(),
                result,
            ),
        )
    return least


def test_distances_of_a_motion_are_those_of_all_kinds_in_their_order(robot: Robot) -> None:
    plan = drawn_plan(robot, seed=2)
    obstacles = moving_bodies(plan)
    found = distances(robot, obstacles, plan.trajectory)
    assert found.of_each.shape[1] == len(obstacles)
    times, q = _between_points(robot, plan.trajectory)
    for row in range(0, len(times), 60):
        wanted = [_by_coal(robot, one, q[row], float(times[row])) for one in obstacles]
        assert found.of_each[row] == pytest.approx(wanted, abs=2e-6)
    least = nearest(robot, obstacles, found)
    column = [one.id for one in obstacles].index(least.obstacle)
    assert least.distance == found.of_each[:, column].min() == found.of_each.min()
    for number, one in enumerate(obstacles):
        told = nearest(robot, obstacles, found, number)
        assert told.obstacle == one.id
        assert told.link


def test_where_bodies_come_nearest_is_on_both_surfaces() -> None:
    robot = bench_robot("lemur", Geometry.SHAPES)
    plan = drawn_plan(robot, seed=2)
    obstacles = moving_bodies(plan)
    found = nearest_bodies.nearest(robot, plan.trajectory, obstacles)
    assert found is not None
    alone = [nearest_bodies.nearest(robot, plan.trajectory, [one]) for one in obstacles]
    least = min((one for one in alone if one is not None), key=lambda one: one.distance)
    assert (found.pair, found.distance) == (least.pair, least.distance)


def test_a_body_that_sweeps_through_the_arm_touches_it() -> None:
    robot = bench_robot("lemur", Geometry.SHAPES)
    plan = drawn_plan(robot, seed=2)
    motion = plan.trajectory
    end, until = motion.ee_positions[-1], float(motion.time[-1] - motion.time[0])
    panel = Obstacle(
        "panel",
        Solid("box", np.array([0.01, 1.0, 1.0])),
        RigidMotion(end - until * np.array([5.0, 0.0, 0.0]), velocity=np.array([5.0, 0.0, 0.0])),
    )
    assert any(pair.endswith("/panel") for pair in touching(robot, motion, [panel]))
    away = panel.with_motion(velocity=np.zeros(3))
    assert not any(pair.endswith("/panel") for pair in touching(robot, motion, [away]))
    # It turns into the arm.
    boom = Obstacle(
        "boom",
        Solid("capsule", np.array([0.02, 64.0])),
        RigidMotion(
            end + np.array([0.0, 30.0, 0.0]),
            np.array([0.0, 0.0, 0.0, 1.0]),
            angular_velocity=np.array([np.pi / 2.0 / until, 0.0, 0.0]),
        ),
    )
    assert any(pair.endswith("/boom") for pair in touching(robot, motion, [boom]))
    assert not touching(robot, motion, [boom.with_motion(angular_velocity=np.zeros(3))]) & {
        f"{body.name}/boom" for body in robot.bodies
    }


def test_a_scene_in_the_browser_has_the_bodies_at_all_times(robot: Robot) -> None:
    plan = drawn_plan(robot, seed=2)
    obstacles = moving_bodies(plan)
    goal: Any = tumbling.problem("tumbling", 0).target
    figure = scene_figure(robot, obstacles, goal, {PLANNED: plan.trajectory}, [PLANNED])
    drawn = [trace for trace in figure.data if trace.legendgroup == "obstacles"]
    assert len(drawn) == len(obstacles)
    for trace, one in zip(drawn, obstacles, strict=True):
        assert one.id in trace.hovertemplate
        corners, triangles = obstacle_surface(one, 24)
        wanted = placed(one, corners, np.zeros(1))[0]
        assert np.stack([trace.x, trace.y, trace.z], axis=1) == pytest.approx(wanted)
        assert len(trace.i) == len(triangles)
    last = figure.frames[-1]
    end = float(plan.trajectory.time[-1])
    moving = [one for one in obstacles if one.moves]
    for entry, one in zip(last.data, moving, strict=False):
        corners, _ = obstacle_surface(one, 24)
        wanted = placed(one, corners, np.array([end]))[0]
        assert np.stack([entry.x, entry.y, entry.z], axis=1) == pytest.approx(wanted)


@pytest.fixture(scope="module")
def capture() -> PlanningProblem:
    drawn = tumbling.problem("tumbling", 0)
    return with_capture_target(with_fixed_bodies(body_of(drawn), 3.0), capture_among_bodies(drawn))


def test_markers_show_bodies_by_their_poses(capture: PlanningProblem) -> None:
    plan = drawn_plan(capture.robot, seed=2)
    markers = plan_markers(capture.robot, plan, scene_of(capture), FRAME).markers
    free = [one for one in capture.obstacles if one.body is None]
    found = [marker for marker in markers if marker.ns == "obstacles"]
    assert len(found) == len(free)
    kinds = {"box": Marker.CUBE}
    for marker, one in zip(found, free, strict=True):
        if one.is_sphere:
            assert marker.type == Marker.SPHERE
            continue
        assert marker.type == kinds.get(one.solid.kind, Marker.TRIANGLE_LIST)
        _check_pose(marker, one, 0.0)
        if one.solid.kind == "box":
            assert [marker.scale.x, marker.scale.y, marker.scale.z] == one.solid.sizes.tolist()
        else:
            corners, triangles = obstacle_surface(one, 24)
            points = [[point.x, point.y, point.z] for point in marker.points]
            assert points == corners[triangles].reshape(-1, 3).tolist()
    paths = [marker for marker in markers if marker.ns == "obstacle_path"]
    assert len(paths) == len([one for one in free if one.moves])
    held = [one for one in capture.obstacles if one.body is not None]
    fixed = [marker for marker in markers if marker.ns == "target_body"]
    assert len(fixed) == SNAPSHOTS * len(held)
    for marker, one in zip(fixed[-len(held) :], held, strict=True):
        _check_pose(marker, one, float(plan.trajectory.time[-1]))


def _check_pose(marker: Marker, one: Obstacle, time: float) -> None:
    place, turn = marker.pose.position, marker.pose.orientation
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
    wanted = placed(one, points, np.array([time]))[0]
    here = turned.apply(points) + np.array([place.x, place.y, place.z])
    # A sphere has no attitude that one could see.
    rows = slice(0, 1) if one.is_sphere else slice(None)
    assert here[rows] == pytest.approx(wanted[rows], abs=1e-9)


@pytest.mark.parametrize("draw", ["above", "capture"])
def test_figures_have_the_outlines_of_bodies(capture: PlanningProblem, draw: str) -> None:
    motions = {PLANNED: drawn_plan(capture.robot, seed=2).trajectory}
    if draw == "above":
        figure = view_from_above(capture, motions)
        (axes,) = figure.axes
        patches = [patch for patch in axes.patches if isinstance(patch, Polygon)]
        moving = [one for one in capture.obstacles if one.moves]
        assert len(patches) == len(capture.obstacles) + len(moving)
    else:
        figure = capture_figure(capture, body_of(capture), motions)
        axes, seen = figure.axes[:2]
        patches = [patch for patch in axes.patches if isinstance(patch, Polygon)]
        assert len(patches) == 2 * len(capture.obstacles)
        free = [one for one in capture.obstacles if one.body is None]
        outlines = [patch for patch in seen.patches if isinstance(patch, Polygon)]
        assert len(outlines) == len(capture.obstacles) + len(free)
    assert all(len(patch.get_xy()) > 3 for patch in patches)


def test_a_report_tells_and_draws_bodies(capture: PlanningProblem, tmp_path: Path) -> None:
    plan = drawn_plan(capture.robot, seed=2)
    task = PlanningTask(capture, load_parameters().planner)
    record_answer(tmp_path / "bag", task, plan, 0.5)
    (reported,) = report_of_bag(tmp_path / "bag", 1).requests
    drawn = reported.plan
    assert drawn is not None
    assert drawn.obstacles is not None
    assert sorted(one.id for one in drawn.obstacles) == sorted(one.id for one in capture.obstacles)
    table = "".join(obstacle_table(capture.robot, drawn.obstacles, plan.trajectory).itertext())
    for words in ("box 0.3 x 0.4 x 0.005", "cone 0.2 x 0.3", "mesh of 4 corners", "turning ["):
        assert words in table
