"""Motions on an air-bearing table, seen from above."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.obstacle_surfaces import obstacle_surface, outline, placed
from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem

# Arm configurations drawn between the start and the end of a motion.
_POSES = 6
_OBSTACLE, _TARGET = "0.75", "tab:red"
_AROUND = 48  # corners of a circle
_HEADING = 0.15  # length of the line that shows the heading of chaser and target [m]


def view_from_above(problem: PlanningProblem, motions: Mapping[Method, Trajectory]) -> Figure:
    """Draw chaser, arm, obstacles and target in the inertial x-y plane; later is darker."""
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    axes = figure.add_subplot()
    for one in problem.obstacles:
        corners, _ = obstacle_surface(one, _AROUND)
        begin, end = placed(one, corners, np.array([0.0, problem.duration]))[..., :2]
        axes.add_patch(Polygon(outline(begin), color=_OBSTACLE))
        if one.moves:
            axes.add_patch(Polygon(outline(end), fill=False, ls="--", ec=_OBSTACLE))
        axes.annotate(one.id, tuple(begin.mean(axis=0)), ha="center", va="center", fontsize=8)
    for method, motion in motions.items():
        _draw_motion(axes, problem, method, motion)
    target = problem.target
    if problem.posture is None:  # which has no place
        axes.plot(*target.position[:2], "x", color=_TARGET, label="target", zorder=4)
    if target.orientation is Orientation.FIXED:
        ahead = Rotation.from_quat(target.quaternion_xyzw).apply([_HEADING, 0.0, 0.0])
        axes.plot(*np.array([target.position, target.position + ahead]).T[:2], color=_TARGET)
    axes.set_aspect("equal")
    axes.margins(0.05)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(visible=True, color="0.9")
    axes.set_axisbelow(True)
    figure.legend(loc="outside upper center", ncols=5, frameon=False)
    return figure


def _draw_motion(axes: Axes, problem: PlanningProblem, method: Method, motion: Trajectory) -> None:
    q, _ = from_trajectory(problem.robot, motion)
    shown = np.unique(np.linspace(0, len(q) - 1, _POSES).astype(int))
    chaser = motion.chaser_positions
    ahead = Rotation.from_quat(motion.chaser_quaternions_xyzw).apply([_HEADING, 0.0, 0.0])
    for point, arm in zip(shown, arm_points(problem.robot, q[shown]), strict=True):
        darkness = 0.25 + 0.75 * motion.time[point] / motion.time[-1]
        links = np.vstack([chaser[point], arm])[:, :2].T
        axes.plot(*links, "o-", color=method.colour, alpha=darkness, markersize=3, linewidth=1.5)
        axes.plot(*np.array([chaser[point], chaser[point] + ahead[point]]).T[:2], color="black")
        axes.plot(*chaser[point, :2], "s", color="black", alpha=darkness, markersize=7)
    axes.plot(
        *motion.ee_positions[:, :2].T,
        color=method.colour,
        linestyle=method.dash,
        linewidth=1.8,
        label=f"end effector, {method.label}",
    )
