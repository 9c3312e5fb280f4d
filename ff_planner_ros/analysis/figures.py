"""Figures of a plan: joint angles; chaser attitude and clearance, all over time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.objectives import chaser_euler
from ff_planner_ros.planning.plan import Plan, Trajectory
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.robot.model import Robot

# Okabe and Ito's colours, told apart by colour-blind readers; then again with another dash.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f")
_DASHES = ("-", "--", "-.", ":")
_LIMIT_STYLE: dict[str, Any] = {"color": "black", "linestyle": (0, (6, 3)), "linewidth": 1.2}


def save_figures(
    robot: Robot, obstacles: Sequence[Sphere], plan: Plan, directory: Path
) -> list[Path]:
    """Draw a plan.

    Args:
        robot: The robot that it was made for.
        obstacles: The spheres that it avoids.
        plan: The plan.
        directory: Made if it is not there; figures of the same name in it are replaced.

    Returns:
        The PNG files written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    figures = {
        "joint_angles.png": joint_angle_figure(robot, plan),
        "attitude_and_clearance.png": attitude_and_clearance_figure(robot, obstacles, plan),
    }
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=150)
    return [directory / name for name in figures]


def joint_angle_figure(robot: Robot, plan: Plan) -> Figure:
    """Draw every joint over time; limits dashed, black where all joints share them.

    Args:
        robot: The robot that the plan was made for.
        plan: The plan.
    """
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    time = plan.trajectory.time
    angles = np.rad2deg(plan.trajectory.joint_positions)
    limits = np.rad2deg([robot.lower_position_limits, robot.upper_position_limits])
    shared = bool(np.all(limits == limits[:, :1]))
    styles = cycle([(colour, dash) for dash in _DASHES for colour in _COLOURS])
    for joint, (name, (colour, dash)) in enumerate(zip(plan.joint_names, styles, strict=False)):
        axes.plot(time, angles[:, joint], dash, color=colour, linewidth=2.0, label=name)
        if not shared:
            for limit in limits[:, joint]:
                axes.axhline(limit, **{**_LIMIT_STYLE, "color": colour})
    if shared:
        for limit in limits[:, 0]:
            axes.axhline(limit, **_LIMIT_STYLE)
    axes.plot([], [], label="joint limits", **_LIMIT_STYLE)
    _finish(axes, time, "joint angle [deg]")
    axes.set_xlabel("time [s]", fontsize=12)
    return figure


def attitude_and_clearance_figure(robot: Robot, obstacles: Sequence[Sphere], plan: Plan) -> Figure:
    """Draw the chaser's attitude above the clearance to the closest obstacle.

    Args:
        robot: The robot that the plan was made for.
        obstacles: The spheres that it avoids.
        plan: The plan.
    """
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    time = plan.trajectory.time
    names = ("roll $\\phi$ (x)", "pitch $\\theta$ (y)", "yaw $\\psi$ (z)")
    q, _ = from_trajectory(robot, plan.trajectory)
    angles = np.rad2deg(np.unwrap(chaser_euler(robot, q), axis=0))
    for name, angle, colour in zip(names, angles.T, _COLOURS, strict=False):
        upper.plot(time, angle, color=colour, linewidth=2.0, label=name)
    largest = np.rad2deg(plan.metrics.max_chaser_euler)
    for bound, label in ((largest, f"largest: {largest:.2f} deg"), (-largest, None)):
        upper.axhline(bound, label=label, **_LIMIT_STYLE)
    _finish(upper, time, "chaser attitude,\nEuler ZYX [deg]")

    if obstacles:
        closest = closest_clearance(robot, obstacles, plan.trajectory)
        certified = plan.metrics.min_clearance
        lower.plot(time, closest, color=_COLOURS[0], linewidth=2.0, label="closest obstacle")
        lower.axhline(certified, label=f"certified: {1e3 * certified:.1f} mm", **_LIMIT_STYLE)
        top, bottom = max(0.0, *closest), min(0.0, *closest)
        margin = 0.06 * (top - bottom)
        lower.axhspan(bottom - margin, 0.0, color=_COLOURS[1], alpha=0.25, label="collision")
        lower.set_ylim(bottom - margin, top + margin)
    else:
        lower.text(0.5, 0.5, "no obstacles", transform=lower.transAxes, ha="center", fontsize=12)
    _finish(lower, time, "clearance [m]")
    lower.set_xlabel("time [s]", fontsize=12)
    return figure


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


def _finish(axes: Axes, time: Array, label: str) -> None:
    axes.set_ylabel(label, fontsize=12)
    axes.set_xlim(float(time[0]), float(time[-1]))
    axes.tick_params(labelsize=11)
    axes.grid(visible=True, color="0.88")
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        # Beside the axes, where it hides no data.
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=10, frameon=False)
