"""Figure of the capture of a tumbling body, in the inertial frame and in the body's."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ff_planner_ros.analysis.drawing.obstacle_surfaces import obstacle_surface, outline, placed
from ff_planner_ros.analysis.drawing.relative_motion import relative_motion
from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target_body import TargetBody

# Arm configurations drawn between the start and the capture.
_POSES = 5
_AROUND = 48  # corners of a circle
_GRASP = "tab:red"
_AT_START: dict[str, Any] = {"fill": False, "linestyle": "--", "edgecolor": "0.7"}
_AT_CAPTURE: dict[str, Any] = {"facecolor": "0.75", "edgecolor": "0.5"}
_AXES = "xyz"
_ROUNDING = 1e-9  # of the time of the capture [s]


def capture_figure(
    problem: PlanningProblem, body: TargetBody, motions: Mapping[Method, Trajectory]
) -> Figure:
    """Draw the capture in the inertial and the body's frame, and distance and speed over time.

    Later is darker. Each view is along the axis of its frame along which the end effector moves
    least.

    Args:
        body: The target body in its state at the plans' first point.
    """
    figure = Figure(figsize=(6.9, 5.2), layout="constrained")
    grid = figure.subplots(2, 2, height_ratios=[1.6, 1.0])
    (inertial, seen), (distance, speed) = grid.tolist()
    _draw_view(inertial, "Inertial frame", problem, body, motions, rides=False)
    _draw_view(seen, "As the target sees it", problem, body, motions, rides=True)
    for axes, quantity in zip((distance, speed), relative_motion(body), strict=True):
        for method, motion in motions.items():
            values = np.linalg.norm(quantity.of(motion), axis=1)
            axes.plot(motion.time, values, color=method.colour, linestyle=method.dash)
        axes.axvline(problem.duration, color=_GRASP, linewidth=0.8)
        axes.set_xlabel("time [s]")
        axes.margins(x=0.0)
        axes.set_ylim(bottom=0.0)
        axes.grid(visible=True, color="0.9")
    distance.set_ylabel("distance from the grasp [m]")
    speed.set_ylabel("relative speed [m/s]")
    figure.legend(
        *inertial.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False
    )
    return figure


def _draw_view(
    axes: Axes,
    title: str,
    problem: PlanningProblem,
    body: TargetBody,
    motions: Mapping[Method, Trajectory],
    *,
    rides: bool,
) -> None:
    """Draw one view: in the body's frame if `rides`, else in the inertial frame."""
    first = next(iter(motions.values()))
    until = first.time <= problem.duration + _ROUNDING
    tips = _seen(body, first.time[until], first.ee_positions[until, None], rides)[:, 0]
    plane = max(
        combinations(range(3), 2), key=lambda pair: float(np.ptp(tips, axis=0)[list(pair)].prod())
    )
    here = list(plane)
    moments = np.array([0.0, problem.duration])
    for number, one in enumerate(problem.obstacles):
        corners, _ = obstacle_surface(one, _AROUND)
        begin, end = _seen(body, moments, placed(one, corners, moments), rides)[..., here]
        labels = ("obstacle at the start", "at the capture") if number == 0 else (None, None)
        if not rides or one.body is None:
            axes.add_patch(Polygon(outline(begin), label=labels[0], **_AT_START))
        axes.add_patch(Polygon(outline(end), label=labels[1], **_AT_CAPTURE))
    for method, motion in motions.items():
        _draw_motion(axes, problem, body, method, motion, here, rides)
    times = np.linspace(0.0, problem.duration, 50)
    grasp = _seen(body, times, body.grasp(times).positions[:, None], rides)[:, 0][:, here]
    axes.plot(*grasp.T, color=_GRASP, linewidth=1.5, linestyle="dotted", zorder=4)
    axes.plot(*grasp[-1], "x", color=_GRASP, label="grasp", zorder=5)
    axes.set_aspect("equal")
    axes.margins(0.05)
    axes.set_title(title, fontsize=11)
    axes.set_xlabel(f"{_AXES[plane[0]]} [m]")
    axes.set_ylabel(f"{_AXES[plane[1]]} [m]")
    axes.grid(visible=True, color="0.9")
    axes.set_axisbelow(True)


def _draw_motion(
    axes: Axes,
    problem: PlanningProblem,
    body: TargetBody,
    method: Method,
    motion: Trajectory,
    here: list[int],
    rides: bool,
) -> None:
    """Draw the arm at some times until the capture, and the end effector's path."""
    q, _ = from_trajectory(problem.robot, motion)
    last = max(1, int(np.searchsorted(motion.time, problem.duration + _ROUNDING)) - 1)
    shown = np.unique(np.linspace(0, last, _POSES).astype(int))
    joints = np.concatenate(
        [motion.chaser_positions[shown, None], arm_points(problem.robot, q[shown])], axis=1
    )
    for point, links in zip(shown, _seen(body, motion.time[shown], joints, rides), strict=True):
        style = {"color": method.colour, "alpha": 0.15 + 0.65 * point / last}
        axes.plot(*links[:, here].T, "o-", markersize=2.5, linewidth=1.3, **style)
        axes.plot(*links[0, here], "s", markersize=7, **(style | {"color": "black"}))
    way = _seen(body, motion.time[: last + 1], motion.ee_positions[: last + 1, None], rides)[:, 0]
    style = {"color": method.colour, "linestyle": method.dash, "linewidth": 2.0}
    axes.plot(*way[:, here].T, label=f"end effector, {method.label}", **style)


def _seen(body: TargetBody, times: Array, places: Array, rides: bool) -> Array:
    """Return points, shape (times, points, 3) [m], in the body's frame if `rides`, else as given.

    Args:
        places: Points in the inertial frame, of the same shape.
    """
    if not rides:
        return places
    motion = body.motion(np.zeros(3), times)
    seen: Array = (places - motion.positions[:, None]) @ motion.rotations
    return seen
