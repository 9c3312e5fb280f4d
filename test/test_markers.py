"""The markers of a plan: everything where the plan has it, in one frame, and nothing left over."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from drawn_plans import POINTS, drawn_plan, paper_terms_at
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from ff_planner_ros.analysis.drawing.solids import robot_surface, surface_at
from ff_planner_ros.analysis.nearest import nearest
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.outputs.markers import SNAPSHOTS, plan_markers

SPHERES = (
    Obstacle.sphere("c1", np.array([1.2, 0.4, 0.54]), 0.20),
    Obstacle.sphere("panel", np.array([-1.0, 2.0, 3.0]), 0.15),
    Obstacle.sphere("panel", np.array([0.0, 0.0, -5.0]), 1.5),
)
SHOWN = (0, 10, 20, 29, 39)  # of 40 points, evenly spaced


@pytest.fixture(scope="module")
def plan(lemur: Robot) -> Plan:
    return drawn_plan(lemur, seed=4)


@pytest.fixture(scope="module")
def markers(lemur: Robot, plan: Plan) -> MarkerArray:
    return plan_markers(lemur, plan, Scene(SPHERES), "world")


def of(markers: MarkerArray, namespace: str) -> list[Marker]:
    return [marker for marker in markers.markers if marker.ns == namespace]


def xyz(message: Any) -> Array:
    return np.array([message.x, message.y, message.z])


def test_what_was_drawn_before_is_deleted_first_and_only_then(markers: MarkerArray) -> None:
    assert markers.markers[0].action == Marker.DELETEALL
    assert {marker.action for marker in markers.markers[1:]} == {Marker.ADD}


def test_every_marker_is_in_the_inertial_frame_whatever_the_time_and_stays(
    markers: MarkerArray,
) -> None:
    for marker in markers.markers:
        assert marker.header.frame_id == "world"
        for time in (marker.header.stamp, marker.lifetime):
            assert (time.sec, time.nanosec) == (0, 0)
        assert not marker.frame_locked


def test_namespaces_and_ids_are_those_documented(markers: MarkerArray) -> None:
    found = [(marker.ns, marker.id) for marker in markers.markers[1:]]
    assert found == [
        *(("obstacles", number) for number in range(3)),
        ("end_effector_path", 0),
        ("chaser_path", 0),
        *(("arm", number) for number in range(SNAPSHOTS)),
        *(("chaser", number) for number in range(SNAPSHOTS)),
    ]


def test_every_sphere_has_its_place_and_its_diameter(markers: MarkerArray) -> None:
    for marker, sphere in zip(of(markers, "obstacles"), SPHERES, strict=True):
        assert marker.type == Marker.SPHERE
        assert np.array_equal(xyz(marker.pose.position), sphere.center)
        assert xyz(marker.scale).tolist() == [2 * sphere.radius] * 3


def test_the_paths_are_those_of_end_effector_and_chaser(markers: MarkerArray, plan: Plan) -> None:
    for namespace, truth in (
        ("end_effector_path", plan.trajectory.ee_positions),
        ("chaser_path", plan.trajectory.chaser_positions),
    ):
        (path,) = of(markers, namespace)
        assert path.type == Marker.LINE_STRIP
        assert len(path.points) == POINTS
        assert np.array_equal([xyz(point) for point in path.points], truth)


def test_the_arm_goes_through_its_joints_to_the_end_effector(
    markers: MarkerArray, plan: Plan
) -> None:
    for marker, point in zip(of(markers, "arm"), SHOWN, strict=True):
        assert marker.type == Marker.LINE_STRIP
        terms = paper_terms_at(plan, point)
        corners = [xyz(corner) for corner in marker.points]
        np.testing.assert_allclose(corners, [*terms.r_joint, terms.r_ee], atol=1e-9)


def test_the_chaser_is_the_box_of_its_inertia_in_its_pose(markers: MarkerArray, plan: Plan) -> None:
    mass, moments = 350.0, np.array([19.7, 15.7, 26.9])  # published
    along_axes = np.sqrt(6 * (moments.sum() - 2 * moments) / mass)
    for marker, point in zip(of(markers, "chaser"), SHOWN, strict=True):
        assert marker.type == Marker.CUBE
        assert np.array_equal(xyz(marker.pose.position), plan.trajectory.chaser_positions[point])
        q = marker.pose.orientation
        box = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        chaser = Rotation.from_quat(plan.trajectory.chaser_quaternions_xyzw[point]).as_matrix()
        # Each edge, as a vector, lies along the chaser's axis that has this length.
        extent = np.abs(chaser.T @ box) @ xyz(marker.scale)
        np.testing.assert_allclose(extent, along_axes, atol=1e-9)


def test_every_marker_can_be_seen_and_the_later_the_better(markers: MarkerArray) -> None:
    for marker in markers.markers[1:]:
        assert 0.0 < marker.color.a <= 1.0
        assert marker.scale.x > 0.0
    for namespace in ("arm", "chaser"):
        opacities = [marker.color.a for marker in of(markers, namespace)]
        assert opacities == sorted(opacities)
        assert len(set(opacities)) == SNAPSHOTS


def test_a_free_scene_has_no_spheres(lemur: Robot, plan: Plan) -> None:
    assert of(plan_markers(lemur, plan, Scene(), "world"), "obstacles") == []


def test_a_robot_with_bodies_is_drawn_as_the_planner_sees_it() -> None:
    """Its triangles instead of the chaser's box, and a line with words where they come nearest."""
    robot = bench_robot("arm6", Geometry.SHAPES)
    plan = drawn_plan(robot, seed=4)
    markers = plan_markers(robot, plan, Scene(SPHERES), "world")
    bodies, (line, words) = of(markers, "bodies"), of(markers, "nearest")
    assert not of(markers, "chaser")
    assert [marker.id for marker in bodies] == list(range(SNAPSHOTS))
    surface, near = robot_surface(robot), nearest(robot, plan.trajectory, SPHERES)
    q, _ = from_trajectory(robot, plan.trajectory)
    for marker, corners in zip(bodies, surface_at(robot, surface, q[list(SHOWN)]), strict=True):
        assert marker.type == Marker.TRIANGLE_LIST
        drawn = np.array([xyz(point) for point in marker.points]).reshape(-1, 3, 3)
        np.testing.assert_array_equal(drawn, corners[surface.triangles])
    assert near is not None
    assert (line.type, words.type) == (Marker.LINE_STRIP, Marker.TEXT_VIEW_FACING)
    np.testing.assert_array_equal([xyz(point) for point in line.points], near.ends)
    assert words.text == near.words
    assert all(marker.color.a > 0.0 and marker.scale.x > 0.0 for marker in (*bodies, line, words))
