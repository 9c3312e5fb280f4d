"""Figures of plans over time, several methods in each: those of the paper, and the joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.plan import Plan, Trajectory
from ff_planner_ros.planning.problem import PlanningProblem, Sphere
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import euler_from_rotation

_XYZ = ("x", "y", "z")
_EULER = ("roll $\\phi$ (x)", "pitch $\\theta$ (y)", "yaw $\\psi$ (z)")
_FORBIDDEN = "0.85"  # light grey, beside which every method's colour stands out
_LIMIT = {"color": "0.35", "linewidth": 1.0, "linestyle": (0, (6, 3))}
_DOTS_PER_INCH = 150


def save_figures(
    problem: PlanningProblem, plans: Mapping[Method, Plan], directory: Path
) -> list[Path]:
    """Draw plans side by side, each figure as PDF and PNG.

    Args:
        problem: What they answer.
        plans: At least one; drawn in this order.
        directory: Made if it is not there; figures of the same name in it are replaced.

    Returns:
        The PNG files written; each has a PDF beside it.
    """
    directory.mkdir(parents=True, exist_ok=True)
    figures = {
        "end_effector": end_effector_figure(plans),
        "chaser_pose": chaser_pose_figure(plans),
        "chaser_velocity": chaser_velocity_figure(plans),
        "clearance": clearance_figure(problem, plans),
        "joint_angles": joint_angle_figure(problem.robot, plans),
    }
    for name, figure in figures.items():
        figure.savefig(directory / f"{name}.png", dpi=_DOTS_PER_INCH)
        # Without a date in it: the same plans give the same file.
        figure.savefig(directory / f"{name}.pdf", metadata={"CreationDate": None})
    return [directory / f"{name}.png" for name in figures]


def end_effector_figure(plans: Mapping[Method, Plan]) -> Figure:
    """Draw position and orientation of the end effector: Fig. 3 of the paper.

    Args:
        plans: At least one.
    """
    figure, columns = _two_columns("end effector position", "end effector orientation, Euler ZYX")
    for method, motion in _motions(plans):
        _draw(columns[0], method, motion.time, motion.ee_positions)
        _draw(columns[1], method, motion.time, _euler_deg(motion.ee_quaternions_xyzw))
    _label(columns[0], [f"{name} [m]" for name in _XYZ])
    _label(columns[1], [f"{name} [deg]" for name in _EULER])
    return _with_legend(figure)


def chaser_pose_figure(plans: Mapping[Method, Plan]) -> Figure:
    """Draw position and attitude of the chaser: Fig. 4 of the paper.

    Args:
        plans: At least one.
    """
    figure, columns = _two_columns("chaser position", "chaser attitude, Euler ZYX")
    for method, motion in _motions(plans):
        _draw(columns[0], method, motion.time, motion.chaser_positions)
        _draw(columns[1], method, motion.time, _euler_deg(motion.chaser_quaternions_xyzw))
    _label(columns[0], [f"{name} [m]" for name in _XYZ])
    _label(columns[1], [f"{name} [deg]" for name in _EULER])
    return _with_legend(figure)


def chaser_velocity_figure(plans: Mapping[Method, Plan]) -> Figure:
    """Draw linear and angular velocity of the chaser: Fig. 5 of the paper.

    Args:
        plans: At least one.
    """
    figure, columns = _two_columns("chaser linear velocity", "chaser angular velocity")
    for method, motion in _motions(plans):
        _draw(columns[0], method, motion.time, motion.chaser_linear_velocities)
        _draw(columns[1], method, motion.time, np.rad2deg(motion.chaser_angular_velocities))
    _label(columns[0], [f"$v_{name}$ [m/s]" for name in _XYZ])
    _label(columns[1], [f"$\\omega_{name}$ [deg/s]" for name in _XYZ])
    return _with_legend(figure)


def clearance_figure(problem: PlanningProblem, plans: Mapping[Method, Plan]) -> Figure:
    """Draw the distance of the arm's centre lines to the closest obstacle: Fig. 6 of the paper.

    Args:
        problem: With the obstacles.
        plans: At least one.
    """
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    for method, motion in _motions(plans):
        # Without obstacles nothing is close; the line stands for the method in the legend.
        closest = np.full(len(motion.time), np.nan)
        if problem.obstacles:
            closest = closest_clearance(problem.robot, problem.obstacles, motion)
        _draw([axes], method, motion.time, closest[:, None])
    if problem.obstacles:
        bottom, top = axes.get_ylim()
        bottom, top = min(bottom, -0.05 * top), max(top, -0.05 * bottom)
        axes.axhspan(bottom, 0.0, color=_FORBIDDEN, label="inside an obstacle", zorder=0)
        axes.axhline(0.0, color="black", linewidth=0.8)
        axes.set_ylim(bottom, top)
    else:
        axes.text(0.5, 0.5, "no obstacles", transform=axes.transAxes, ha="center")
    _label([axes], ["distance to closest obstacle [m]"])
    return _with_legend(figure)


def joint_angle_figure(robot: Robot, plans: Mapping[Method, Plan]) -> Figure:
    """Draw every joint in a panel of its own, with its limits.

    Args:
        robot: The robot that the plans were made for.
        plans: At least one.
    """
    rows = -(-robot.joints // 2)
    figure = Figure(figsize=(8.0, 1.0 + 1.5 * rows), layout="constrained")
    grid = figure.subplots(rows, 2, squeeze=False).ravel().tolist()
    panels, spare = grid[: robot.joints], grid[robot.joints :]
    for method, motion in _motions(plans):
        _draw(panels, method, motion.time, np.rad2deg(motion.joint_positions))
    limits = np.rad2deg([robot.lower_position_limits, robot.upper_position_limits])
    for axes, pair in zip(panels, limits.T, strict=True):
        for limit, label in zip(pair, ("joint limits", None), strict=True):
            axes.axhline(limit, label=label, **_LIMIT)
    _label(panels, [f"{name} [deg]" for name in robot.joint_names])
    for axes in panels:
        axes.set_xlabel("")
    for axes in spare:
        axes.set_visible(False)
    figure.supxlabel("time [s]", fontsize="medium")
    return _with_legend(figure)


def closest_clearance(robot: Robot, obstacles: Sequence[Sphere], trajectory: Trajectory) -> Array:
    """Return the distance between the arm's lines and the nearest sphere's surface.

    Args:
        robot: The robot.
        obstacles: At least one sphere.
        trajectory: The sampled motion.

    Returns:
        Shape (points,) [m].
    """
    q, _ = from_trajectory(robot, trajectory)
    positions = arm_points(robot, q)
    distance = clearances(positions, segments(positions), obstacles).distance
    closest: Array = distance.min(axis=(1, 2))
    return closest


def _motions(plans: Mapping[Method, Plan]) -> Iterable[tuple[Method, Trajectory]]:
    return ((method, plan.trajectory) for method, plan in plans.items())


def _euler_deg(quaternions_xyzw: Array) -> Array:
    """Return the paper's Euler angles [deg] without jumps, theta beyond 90 deg where it gets there.

    Two triples describe each rotation, and full turns more; each point takes the one that is
    nearest to the point before. Shape (points, 3).
    """
    angles = euler_from_rotation(Rotation.from_quat(quaternions_xyzw).as_matrix())
    for before, now in pairwise(angles):
        beyond = np.array([now[0] + np.pi, np.pi - now[1], now[2] + np.pi])
        nearest = [before + np.angle(np.exp(1j * (angle - before))) for angle in (now, beyond)]
        now[:] = min(nearest, key=lambda angle: float(np.abs(angle - before).sum()))
    return np.rad2deg(angles)


def _two_columns(left: str, right: str) -> tuple[Figure, list[list[Axes]]]:
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    grid = figure.subplots(3, 2, sharex=True)
    for axes, title in zip(grid[0], (left, right), strict=True):
        axes.set_title(title, fontsize=11)
    return figure, grid.T.tolist()


def _draw(panels: Sequence[Axes], method: Method, time: Array, values: Array) -> None:
    """Draw one curve in each panel. Values: shape (points, panels)."""
    for axes, curve in zip(panels, values.T, strict=True):
        axes.plot(
            time,
            curve,
            color=method.colour,
            linestyle=method.dash,
            linewidth=1.8,
            label=method.label,
        )


def _label(panels: Sequence[Axes], names: Sequence[str]) -> None:
    for axes, name in zip(panels, names, strict=True):
        axes.set_ylabel(name)
        axes.margins(x=0.0)
        axes.grid(visible=True, color="0.9")
        axes.set_axisbelow(True)
    panels[-1].set_xlabel("time [s]")


def _with_legend(figure: Figure) -> Figure:
    """Put one legend above all panels, where it hides no data."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False)
    return figure
