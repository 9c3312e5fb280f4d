"""Figures of plans: what they draw is what the plans hold, and nothing hides anything."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_plans import POINTS, distance_to_arm, drawn_plan, quaternions
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.figures import (
    clearance_figure,
    joint_figure,
    save_figures,
    two_column_figure,
)
from ff_planner_ros.analysis.drawing.panels import (
    CHASER_POSE,
    CHASER_VELOCITY,
    END_EFFECTOR_POSE,
    joint_angles,
    joint_rates,
    joint_torques,
)
from ff_planner_ros.analysis.extremes import distances
from ff_planner_ros.analysis.methods import (
    FIXED_BASE,
    PAPERS_METHODS,
    SHORTEST,
    STEADIEST,
    STRAIGHT_LINE,
    WEIGHTED,
    ZERO_MOMENTUM,
    Method,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Robot

ALL_METHODS = (*PAPERS_METHODS, WEIGHTED, FIXED_BASE, ZERO_MOMENTUM)


@pytest.fixture(scope="module")
def plans(lemur: Robot) -> dict[Method, Plan]:
    """A plan per method of the paper, each another."""
    return {method: drawn_plan(lemur, seed) for seed, method in enumerate(PAPERS_METHODS)}


def motions_of(plans: dict[Method, Plan]) -> dict[Method, Trajectory]:
    return {method: plan.trajectory for method, plan in plans.items()}


@pytest.fixture(scope="module")
def figures(lemur_capture: PlanningProblem, plans: dict[Method, Plan]) -> dict[str, Figure]:
    return {
        "end effector": two_column_figure(END_EFFECTOR_POSE, motions_of(plans)),
        "chaser pose": two_column_figure(CHASER_POSE, motions_of(plans)),
        "chaser velocity": two_column_figure(CHASER_VELOCITY, motions_of(plans)),
        "clearance": clearance_figure(lemur_capture, motions_of(plans)),
        "joint angles": joint_figure(joint_angles(lemur_capture.robot), motions_of(plans)),
    }


def curves(axes: Axes) -> dict[str, Array]:
    """Ordinates of the lines in the legend, by label."""
    lines = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
    return {str(line.get_label()): np.asarray(line.get_ydata()) for line in lines}


def euler_deg(quaternions_xyzw: Array) -> Array:
    angles: Array = Rotation.from_quat(quaternions_xyzw).as_euler("ZYX", degrees=True)[:, ::-1]
    return angles


def columns(left: Array, right: Array) -> list[Array]:
    """Curves of a grid of three rows and two columns, in matplotlib's order."""
    return [column for pair in zip(left.T, right.T, strict=True) for column in pair]


DRAWN: dict[str, Callable[[Trajectory], list[Array]]] = {
    "end effector": lambda t: columns(t.ee_positions, euler_deg(t.ee_quaternions_xyzw)),
    "chaser pose": lambda t: columns(t.chaser_positions, euler_deg(t.chaser_quaternions_xyzw)),
    "chaser velocity": lambda t: columns(
        t.chaser_linear_velocities, np.rad2deg(t.chaser_angular_velocities)
    ),
    "joint angles": lambda t: list(np.rad2deg(t.joint_positions).T),
}


@pytest.mark.parametrize("name", DRAWN)
def test_every_curve_is_an_array_of_its_methods_plan(
    name: str, figures: dict[str, Figure], plans: dict[Method, Plan]
) -> None:
    panels = [axes for axes in figures[name].axes if axes.get_visible()]
    # The chaser's attitude is that since the start, the same for all methods.
    first = next(iter(plans.values())).trajectory.chaser_quaternions_xyzw[0]
    for method, plan in plans.items():
        turned = Rotation.from_quat(first).inv() * Rotation.from_quat(
            plan.trajectory.chaser_quaternions_xyzw
        )
        expected = DRAWN[name](replace(plan.trajectory, chaser_quaternions_xyzw=turned.as_quat()))
        for axes, curve in zip(panels, expected, strict=True):
            np.testing.assert_allclose(curves(axes)[method.label], curve, atol=1e-9)
            for line in axes.lines[: len(plans)]:
                np.testing.assert_array_equal(line.get_xdata(), plan.trajectory.time)


LABELS = {
    "end effector": ["x [m]", "roll", "y [m]", "pitch", "z [m]", "yaw"],
    "chaser pose": ["x [m]", "roll", "y [m]", "pitch", "z [m]", "yaw"],
    "chaser velocity": ["v_x", "ω_x", "v_y", "ω_y", "v_z", "ω_z"],
    "clearance": ["distance to closest obstacle [mm]"],
    "joint angles": [f"joint_{k} [deg]" for k in range(1, 8)],
}


@pytest.mark.parametrize("name", LABELS)
def test_every_panel_names_its_quantity_and_unit(name: str, figures: dict[str, Figure]) -> None:
    panels = [axes for axes in figures[name].axes if axes.get_visible()]
    for axes, words in zip(panels, LABELS[name], strict=True):
        assert words in axes.get_ylabel()
        assert axes.get_ylabel().endswith(("[m]", "[mm]", "[deg]", "[m/s]", "[deg/s]"))


@pytest.mark.parametrize("name", LABELS)
def test_the_legend_names_every_method_and_hides_no_data(
    name: str, figures: dict[str, Figure]
) -> None:
    figure = figures[name]
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels[:4] == ["straight line", "APF", "min(L)", "min(Θ)"]
    figure.draw_without_rendering()
    frame = legend.get_window_extent()
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert not any(frame.overlaps(axes.get_tightbbox()) for axes in panels)
    assert figure.bbox.containsx(frame.x0)
    assert figure.bbox.containsx(frame.x1)


def test_a_method_has_its_colour_and_dash_in_every_figure(figures: dict[str, Figure]) -> None:
    for method in PAPERS_METHODS:
        lines = [
            line
            for figure in figures.values()
            for axes in figure.axes
            for line in axes.lines
            if line.get_label() == method.label
        ]
        assert len(lines) == 3 * 6 + 1 + 7
        styles = {(to_rgba(line.get_color()), line.get_linestyle()) for line in lines}
        own = Line2D([], [], color=method.colour, linestyle=method.dash)
        assert styles == {(to_rgba(own.get_color()), own.get_linestyle())}


def test_no_two_methods_share_a_colour_and_no_two_of_the_paper_a_dash() -> None:
    assert len({method.colour for method in ALL_METHODS}) == len(ALL_METHODS)
    assert len({method.dash for method in PAPERS_METHODS}) == len(PAPERS_METHODS)


def test_orientation_that_passes_the_angles_singularity_is_drawn_without_a_jump(
    lemur: Robot,
) -> None:
    truth = np.linspace([-45.0, 55.0, -65.0], [-30.0, 145.0, -130.0], POINTS)
    plan = drawn_plan(lemur, 0)
    turned = replace(plan.trajectory, ee_quaternions_xyzw=quaternions(truth))
    panels = two_column_figure(END_EFFECTOR_POSE, {SHORTEST: turned}).axes[1::2]
    drawn = np.stack([curves(axes)["min(L)"] for axes in panels], axis=1)
    np.testing.assert_allclose(drawn, truth, atol=1e-6)


def test_attitude_is_drawn_without_a_jump_where_its_angles_pass_180_degrees(lemur: Robot) -> None:
    truth = np.linspace([0.0, 0.0, 0.0], [250.0, 20.0, -300.0], POINTS)
    motions = motions_of({SHORTEST: drawn_plan(lemur, 0, truth)})
    panels = two_column_figure(CHASER_POSE, motions).axes[1::2]
    drawn = np.stack([curves(axes)["min(L)"] for axes in panels], axis=1)
    np.testing.assert_allclose(drawn, truth, atol=1e-6)


def test_clearance_is_the_distance_from_the_nearest_link_to_the_nearest_sphere(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan], figures: dict[str, Figure]
) -> None:
    (axes,) = figures["clearance"].axes
    for method in (STRAIGHT_LINE, STEADIEST):
        expected = [
            1e3
            * min(
                distance_to_arm(plans[method], point, sphere.center) - sphere.radius
                for sphere in lemur_capture.obstacles
            )
            for point in range(POINTS)
        ]
        (line,) = (line for line in axes.lines if line.get_label() == method.label)
        drawn = np.interp(plans[method].trajectory.time, line.get_xdata(), line.get_ydata())
        np.testing.assert_allclose(drawn, expected, atol=1e-3)


def test_the_least_clearance_of_every_method_is_marked_and_said_in_millimetres(
    plans: dict[Method, Plan], figures: dict[str, Figure]
) -> None:
    (axes,) = figures["clearance"].axes
    marks = [line for line in axes.lines if line.get_marker() == "o"]
    said = figures["clearance"].get_supxlabel()
    for method, mark in zip(plans, marks, strict=True):
        (line,) = (line for line in axes.lines if line.get_label() == method.label)
        least = int(np.argmin(line.get_ydata()))
        assert [*mark.get_xdata(), *mark.get_ydata()] == [
            line.get_xdata()[least],
            line.get_ydata()[least],
        ]
        assert mark.get_color() == method.colour
        time, value = line.get_xdata()[least], line.get_ydata()[least]
        assert re.search(rf"{re.escape(method.label)}: {value:.1f} mm to c\d at {time:.2f} s", said)


@pytest.mark.parametrize("radius", [0.05, 5.0])
def test_zero_clearance_is_marked_with_the_inside_of_obstacles_below_it(
    radius: float, lemur_capture: PlanningProblem, plans: dict[Method, Plan]
) -> None:
    """Whether all curves are above zero, or all below."""
    obstacles = tuple(
        replace(sphere, shape=Solid("sphere", [radius])) for sphere in lemur_capture.obstacles
    )
    problem = replace(lemur_capture, obstacles=obstacles)
    motion = plans[SHORTEST].trajectory
    signs = np.sign(distances(problem.robot, obstacles, motion).closest)
    assert set(signs) == {1.0 if radius < 1.0 else -1.0}
    (axes,) = clearance_figure(problem, motions_of(plans)).axes
    bottom, top = axes.get_ylim()
    assert bottom < 0.0 < top
    (inside,) = axes.patches
    assert inside.get_label() == "inside an obstacle"
    assert (inside.get_y(), inside.get_y() + inside.get_height()) == (bottom, 0.0)
    assert any(set(line.get_ydata()) == {0.0} for line in axes.lines)


def test_without_obstacles_the_figure_says_so(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan]
) -> None:
    figure = clearance_figure(replace(lemur_capture, obstacles=()), motions_of(plans))
    assert [text.get_text() for text in figure.axes[0].texts] == ["no obstacles"]
    assert len(figure.legends[0].get_texts()) == len(plans)


def test_each_joint_is_drawn_with_its_own_limits(lemur: Robot, plans: dict[Method, Plan]) -> None:
    lower = np.deg2rad(np.arange(-170.0, -163.0))
    robot = replace(lemur, lower_position_limits=lower)
    figure = joint_figure(joint_angles(robot), motions_of(plans))
    for axes, limit in zip(figure.axes, np.rad2deg(lower), strict=False):
        levels = [line.get_ydata()[0] for line in axes.lines if len(line.get_ydata()) == 2]
        np.testing.assert_allclose(levels, [limit, 180.0])
        assert axes.get_title(loc="right") == f"limits {limit:g} to 180"
    assert figure.legends[0].get_texts()[-1].get_text() == "limits"


def test_curves_of_joints_fill_their_panels_and_limits_far_away_do_not_press_them_flat(
    lemur: Robot, plans: dict[Method, Plan]
) -> None:
    motions = motions_of(plans)
    for quantity in (joint_angles(lemur), joint_rates(lemur), joint_torques(lemur)):
        figure = joint_figure(quantity, motions)
        for k, axes in enumerate(axes for axes in figure.axes if axes.get_visible()):
            values = np.concatenate([quantity.of(motion)[:, k] for motion in motions.values()])
            low, high = axes.get_ylim()
            assert low < values.min() < values.max() < high
            assert np.ptp(values) > 0.85 * (high - low)


@pytest.mark.nightly
def test_every_figure_is_written_as_png_and_dateless_pdf_into_a_new_directory(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan], tmp_path: Path
) -> None:
    directory = tmp_path / "new" / "figures"
    written = save_figures(lemur_capture, motions_of(plans), directory)
    names = (
        *("end_effector", "chaser_pose", "chaser_velocity", "clearance"),
        *("joint_angles", "joint_rates", "joint_torques"),
    )
    assert written == [directory / f"{name}.png" for name in names]
    for path in written:
        picture = imread(path)
        assert min(picture.shape[:2]) >= 700
        assert len(np.unique(picture[::7, ::7].reshape(-1, picture.shape[2]), axis=0)) > 100
        document = path.with_suffix(".pdf").read_bytes()
        assert document.startswith(b"%PDF")
        assert b"CreationDate" not in document  # the same plans give the same file


def test_drawing_starts_no_window_system() -> None:
    module = "ff_planner_ros.analysis.drawing.figures"
    program = f"import sys, {module}; print('matplotlib.pyplot' in sys.modules)"
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "False"
