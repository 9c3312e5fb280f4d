"""Figures of plans over time, several methods in each: those of the paper, and the joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ff_planner_ros.analysis.drawing.capture_view import capture_figure
from ff_planner_ros.analysis.drawing.from_above import view_from_above
from ff_planner_ros.analysis.drawing.panels import (
    CHASER_POSE,
    CHASER_VELOCITY,
    END_EFFECTOR_POSE,
    Panel,
    Quantity,
    clearance_panel,
    joint_angles,
    joint_rates,
    joint_torques,
    panels,
    wheel_quantities,
)
from ff_planner_ros.analysis.drawing.relative_motion import relative_motion
from ff_planner_ros.analysis.drawing.scene import save_scene
from ff_planner_ros.analysis.methods import PLANNED, Method
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.common.text_file import AnyPath, path_of
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.robot.model import Base

_FORBIDDEN = "0.85"  # light grey, beside which every method's colour stands out
_LIMIT: dict[str, Any] = {"color": "0.35", "linewidth": 1.0, "linestyle": (0, (6, 3))}
_DOTS_PER_INCH = 150


def plot_plan(problem: PlanningProblem, plan: Plan, directory: AnyPath) -> list[Path]:
    """Draw a plan: figures over time, each as PNG and PDF, and its scene.

    The scene is an interactive page.

    Args:
        directory: Created if it is missing; files of the same name in it are replaced.

    Returns:
        The PNG files, and `scene.html`.

    Raises:
        InvalidInput: An argument is of another kind, or `directory` is a file.
    """
    an_object("problem", problem, PlanningProblem)
    an_object("plan", plan, Plan)
    place = path_of("directory", directory)
    if place.exists() and not place.is_dir():
        allowed = "it must be a directory, or not exist yet"
        raise InvalidInput(Status.OUT_OF_RANGE, "directory", place, allowed)
    problem = lasting(problem, plan.duration)
    motions, scene = {PLANNED: plan.trajectory}, place / "scene.html"
    pictures = save_figures(problem, motions, place)
    save_scene(problem, motions, motions, scene)
    return [*pictures, scene]


def save_figures(
    problem: PlanningProblem, motions: Mapping[Method, Trajectory], directory: Path
) -> list[Path]:
    """Draw motions as PNG and PDF into a directory, created if missing; return the PNG files."""
    directory.mkdir(parents=True, exist_ok=True)
    figures = {
        "end_effector": two_column_figure(END_EFFECTOR_POSE, motions),
        "chaser_pose": two_column_figure(CHASER_POSE, motions),
        "chaser_velocity": two_column_figure(CHASER_VELOCITY, motions),
        "clearance": clearance_figure(problem, motions),
        "joint_angles": joint_figure(joint_angles(problem.robot), motions),
        "joint_rates": joint_figure(joint_rates(problem.robot), motions),
        "joint_torques": joint_figure(joint_torques(problem.robot), motions),
    }
    if problem.robot.wheels is not None:
        stored = problem.start.wheel_momenta
        for name, quantity in wheel_quantities(problem.robot, stored).items():
            figures[name] = joint_figure(quantity, motions)
    if problem.robot.base is Base.PLANAR:
        figures["from_above"] = view_from_above(problem, motions)
    if problem.target_body is not None:
        seen = relative_motion(problem.target_body)
        figures["relative_motion"] = two_column_figure(seen, motions)
        figures["capture"] = capture_figure(problem, problem.target_body, motions)
    for name, figure in figures.items():
        _settle(figure)
        figure.savefig(directory / f"{name}.png", dpi=_DOTS_PER_INCH)
        # Without a date in it: the same plans give the same file.
        figure.savefig(directory / f"{name}.pdf", metadata={"CreationDate": None})
    return [directory / f"{name}.png" for name in figures]


def two_column_figure(
    quantities: tuple[Quantity, Quantity], motions: Mapping[Method, Trajectory]
) -> Figure:
    """Draw two quantities side by side, a row for each component: Figs. 3 to 5 of the paper."""
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    grid = figure.subplots(3, 2, sharex=True)
    for column, quantity in zip(grid.T, quantities, strict=True):
        column[0].set_title(quantity.title, fontsize=11)
        _draw(column, quantity, motions)
    return _with_legend(figure)


def clearance_figure(problem: PlanningProblem, motions: Mapping[Method, Trajectory]) -> Figure:
    """Draw the robot's distance to the closest obstacle, as `clearance_panel` has it: Fig. 6."""
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    axes = figure.add_subplot()
    panel = clearance_panel(problem.robot, problem.obstacles, motions, scene_of(problem))
    _draw_panel(axes, panel)
    axes.set_xlabel("time [s]")
    if problem.obstacles:
        bottom, top = axes.get_ylim()
        bottom, top = min(bottom, -0.05 * top), max(top, -0.05 * bottom)
        axes.axhspan(bottom, 0.0, color=_FORBIDDEN, label="inside an obstacle", zorder=0)
        axes.axhline(0.0, color="black", linewidth=0.8)
        axes.set_ylim(bottom, top)
        for mark in panel.marks:
            axes.plot(mark.time, mark.value, "o", color=mark.method.colour)
        # The curves are crowded where they are lowest: what is said of those points stands aside.
        said = [f"{mark.method.label}: {mark.words}" for mark in panel.marks]
        figure.supxlabel("at the least:  " + "\n".join(said), fontsize=9, x=0.02, ha="left")
    else:
        axes.text(0.5, 0.5, "no obstacles", transform=axes.transAxes, ha="center")
    return _with_legend(figure)


def joint_figure(quantity: Quantity, motions: Mapping[Method, Trajectory]) -> Figure:
    """Draw a quantity of the joints or wheels, a panel for each.

    The axes span the curves: limits beyond them are only noted above the panel.
    """
    rows = -(-len(quantity.labels) // 2)
    figure = Figure(figsize=(8.0, 1.0 + 1.5 * rows), layout="constrained")
    grid = figure.subplots(rows, 2, squeeze=False).ravel().tolist()
    drawn, spare = grid[: len(quantity.labels)], grid[len(quantity.labels) :]
    for axes, panel in zip(drawn, panels(quantity, motions), strict=True):
        _draw_panel(axes, panel)
        axes.set_ylim(*panel.span)
        axes.set_title(panel.note, fontsize=8, loc="right", color=_LIMIT["color"], pad=2)
    for axes in spare:
        axes.set_visible(False)
    figure.supxlabel("time [s]", fontsize="medium")
    return _with_legend(figure)


def _settle(figure: Figure) -> None:
    """Find where everything goes, once and not anew for every file."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)  # or each file is drawn twice


def _draw(grid: Sequence[Axes], quantity: Quantity, motions: Mapping[Method, Trajectory]) -> None:
    for axes, panel in zip(grid, panels(quantity, motions), strict=True):
        _draw_panel(axes, panel)
    grid[-1].set_xlabel("time [s]")


def _draw_panel(axes: Axes, panel: Panel) -> None:
    last = max(float(curve[0][-1]) for curve in panel.curves.values())
    for method, curve in panel.curves.items():
        style: dict[str, Any] = {"color": method.colour, "linestyle": method.dash, "linewidth": 1.8}
        axes.plot(*curve, label=method.label, **style)
        if curve[0][-1] < last:  # it ends here, and is not hidden
            axes.plot(*(part[-1:] for part in curve), "o", color=method.colour, markersize=4)
    for number, level in enumerate(panel.levels):
        if np.isfinite(level):
            label = "limits" if number == 0 else None
            axes.axhline(level, label=label, **_LIMIT)
    axes.set_ylabel(panel.label)
    axes.margins(x=0.0)
    axes.grid(visible=True, color="0.9")
    axes.set_axisbelow(True)


def _with_legend(figure: Figure) -> Figure:
    """Put one legend above all panels, where it hides no data."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False)
    return figure
