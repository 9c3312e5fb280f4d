"""Figures of a plan."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.image import imread
from paper_equations import paper_terms
from robots import LEMUR_URDF, canadarm2_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.figures import (
    attitude_and_clearance_figure,
    closest_clearance,
    joint_angle_figure,
    save_figures,
)
from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import Metrics, Plan, SolverReport, Trajectory
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

POINTS = 40


def swing(robot: Robot, euler_end_deg: tuple[float, float, float] = (4.0, -9.0, 14.0)) -> Plan:
    """A plan as a drawing needs it: all joints swing while the chaser drifts and turns."""
    s = np.linspace(0.0, 1.0, POINTS)[:, None]
    start = np.linspace(0.2, -2.2, robot.joints)
    euler = s * np.deg2rad(euler_end_deg)
    rotations = Rotation.from_euler("ZYX", euler[:, ::-1])
    still = np.zeros((POINTS, 3))
    trajectory = Trajectory(
        time=10.0 * s[:, 0],
        joint_positions=start + s**2 * np.linspace(-0.3, 0.6, robot.joints),
        joint_velocities=np.zeros((POINTS, robot.joints)),
        joint_accelerations=np.zeros((POINTS, robot.joints)),
        chaser_positions=s * [0.2, 0.0, 0.5],
        chaser_quaternions_xyzw=rotations.as_quat(),
        chaser_linear_velocities=still,
        chaser_angular_velocities=still,
        ee_positions=still,
        ee_quaternions_xyzw=rotations.as_quat(),
        ee_linear_velocities=still,
        ee_angular_velocities=still,
    )
    return Plan(
        joint_names=robot.joint_names,
        trajectory=trajectory,
        xi=np.zeros(18),
        orientation_reading="",
        metrics=Metrics(
            **{
                **dict.fromkeys((item.name for item in fields(Metrics)), 0.0),
                "max_chaser_euler": float(np.abs(euler).max()),
                "min_clearance": 0.0123,
            }
        ),
        solver=SolverReport(
            starts=1, iterations=1, rollouts=1, optimality=0.0, stop_reason="drawn by hand"
        ),
    )


def distance_to_arm(plan: Plan, point: int, center: Array) -> float:
    """From a sphere's centre to the nearest of many places on the arm's links."""
    trajectory = plan.trajectory
    terms = paper_terms(
        LEMUR_URDF.read_text(),
        "chaser",
        "end_effector",
        r_ch=trajectory.chaser_positions[point],
        rotation_ch=Rotation.from_quat(trajectory.chaser_quaternions_xyzw[point]).as_matrix(),
        theta=trajectory.joint_positions[point],
    )
    corners = np.vstack([terms.r_joint, terms.r_ee])
    along = np.linspace(0.0, 1.0, 2001)[:, None]
    places = [a + along * (b - a) for a, b in pairwise(corners)]
    return float(np.linalg.norm(np.concatenate(places) - center, axis=1).min())


def test_clearance_is_the_distance_from_the_nearest_link_to_the_nearest_sphere(
    lemur_capture: PlanningProblem,
) -> None:
    plan = swing(lemur_capture.robot)
    closest = closest_clearance(lemur_capture.robot, lemur_capture.obstacles, plan.trajectory)
    expected = [
        min(distance_to_arm(plan, point, o.center) - o.radius for o in lemur_capture.obstacles)
        for point in range(POINTS)
    ]
    np.testing.assert_allclose(closest, expected, atol=1e-6)


def test_attitude_is_continuous_where_its_angles_pass_180_degrees(lemur: Robot) -> None:
    plan = swing(lemur, euler_end_deg=(250.0, 20.0, -300.0))
    upper, _ = attitude_and_clearance_figure(lemur, (), plan).axes
    ends = [np.asarray(line.get_ydata())[-1] for line in upper.lines[:3]]
    np.testing.assert_allclose(ends, [250.0, 20.0, -300.0])


def test_joint_angles_are_drawn_in_degrees_with_their_limits(lemur: Robot) -> None:
    plan = swing(lemur)
    (axes,) = joint_angle_figure(lemur, plan).axes
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.lines}
    for name, angles in zip(lemur.joint_names, plan.trajectory.joint_positions.T, strict=True):
        np.testing.assert_allclose(lines[name], np.rad2deg(angles))
    assert [line.get_ydata()[0] for line in axes.lines[7:9]] == [-180.0, 180.0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "joint angle [deg]")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        *lemur.joint_names,
        "joint limits",
    ]


def test_limits_that_differ_are_drawn_in_the_colour_of_their_joint() -> None:
    urdf = canadarm2_urdf().replace('upper="4.71239"', 'upper="2.0"', 1)
    robot = robot_from_urdf_text(urdf, "station", "hand")
    (axes,) = joint_angle_figure(robot, swing(robot)).axes
    first, _, upper_limit = axes.lines[:3]
    np.testing.assert_allclose(upper_limit.get_ydata(), np.rad2deg(2.0))
    assert upper_limit.get_color() == first.get_color()
    assert len({line.get_color() for line in axes.lines[:-1]}) == 7


def test_attitude_and_clearance_are_drawn_over_the_same_time(
    lemur_capture: PlanningProblem,
) -> None:
    robot, obstacles = lemur_capture.robot, lemur_capture.obstacles
    plan = swing(robot)
    upper, lower = attitude_and_clearance_figure(robot, obstacles, plan).axes
    assert upper.get_xlim() == lower.get_xlim() == (0.0, 10.0)
    ends = [np.asarray(line.get_ydata())[-1] for line in upper.lines]
    np.testing.assert_allclose(ends, [4.0, -9.0, 14.0, 14.0, -14.0])
    np.testing.assert_array_equal(
        lower.lines[0].get_ydata(), closest_clearance(robot, obstacles, plan.trajectory)
    )
    assert [text.get_text() for text in lower.get_legend().get_texts()] == [
        "closest obstacle",
        "certified: 12.3 mm",
        "collision",
    ]


def test_without_obstacles_the_figure_says_so(lemur: Robot) -> None:
    _, lower = attitude_and_clearance_figure(lemur, (), swing(lemur)).axes
    assert [text.get_text() for text in lower.texts] == ["no obstacles"]


def test_two_pictures_are_written_into_a_new_directory(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    directory = tmp_path / "new" / "figures"
    plan = swing(lemur_capture.robot)
    written = save_figures(lemur_capture.robot, lemur_capture.obstacles, plan, directory)
    assert written == [directory / "joint_angles.png", directory / "attitude_and_clearance.png"]
    for path in written:
        picture = imread(path)
        assert min(picture.shape[:2]) >= 700
        assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 100


def test_drawing_starts_no_window_system() -> None:
    program = (
        "import sys, ff_planner_ros.analysis.figures; print('matplotlib.pyplot' in sys.modules)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "False"
