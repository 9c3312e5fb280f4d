"""The plots of one plan, as planned and as measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np
import plotly.graph_objects as go

from ff_planner_ros.analysis.drawing.panels import (
    CHASER_POSE,
    CHASER_VELOCITY,
    END_EFFECTOR_POSE,
    panels,
    wheel_quantities,
)
from ff_planner_ros.analysis.drawing.plots import (
    clearance_plot,
    joint_plot,
    panel_plot,
    two_column_plot,
)
from ff_planner_ros.analysis.drawing.scene import scene_figure
from ff_planner_ros.analysis.drawing.surroundings import drawn_constraints
from ff_planner_ros.analysis.drawing.tracking import Deviations, deviation_panels, in_shown_units
from ff_planner_ros.analysis.methods import MEASURED, PLANNED
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.report.run_report import ReportedPlan
from ff_planner_ros.report.statistics_plots import evenly_spaced


def plan_plots(plan: ReportedPlan) -> Iterator[tuple[str, str, go.Figure]]:
    """Yield name, caption and figure of each plot of a plan."""
    robot, obstacles = plan.robot, plan.obstacles or ()
    motions = {PLANNED: plan.motion}
    if plan.measured is not None and plan.deviations is not None:
        motions[MEASURED] = _rows_of(plan.measured, shown_rows(plan.deviations))
    allowed = plan.scene.allowed_collisions
    scene = scene_figure(robot, obstacles, plan.goal, motions, motions, allowed, controls=False)
    scene.add_traces(list(drawn_constraints(plan.scene, robot, plan.motion)))
    words = (
        "Arm, chaser and obstacles (the paper's Fig. 2): drag to turn. The axes of end effector "
        "and goal are x red, y green, z blue; "
    )
    words += (
        "the bodies are those that the planner keeps clear; a red line marks where they come "
        "nearest to each other or to an obstacle, but for what may touch."
        if robot.bodies
        else "the box of lines has the chaser's mass and inertia."
    )
    yield "scene", words, scene
    all_of = " and ".join(method.label for method in motions)
    if plan.obstacles is not None:
        what = "bodies" if robot.bodies else "arm"
        words = f"Distance of the {what} to the closest obstacle, {all_of} (Fig. 6)."
        yield "clearance", words, clearance_plot(robot, obstacles, motions, plan.scene)
    words = f"Joints, {all_of}; a double click zooms out to the limits, which are dashed."
    yield "joints", words, joint_plot(robot, motions)
    for name, quantity in wheel_quantities(robot, plan.stored).items():
        words = f"{quantity.title.capitalize()}, {all_of}; limits are dashed."
        yield name.replace("_", "-"), words, panel_plot(panels(quantity, motions))
    for name, words, fig, shown in (
        ("end-effector", "End effector", 3, END_EFFECTOR_POSE),
        ("chaser-pose", "Chaser", 4, CHASER_POSE),
        ("chaser-velocity", "Chaser's velocity", 5, CHASER_VELOCITY),
    ):
        yield name, f"{words}, {all_of} (Fig. {fig}).", two_column_plot(shown, motions)
    if plan.deviations is not None:
        plot = panel_plot(deviation_panels(plan.deviations, shown_rows(plan.deviations)))
        yield "deviations", "How far the measured states are from the plan.", plot


def shown_rows(found: Deviations) -> np.ndarray:
    """Return indices of the states to draw: evenly spaced, and the worst of each deviation."""
    worst = [int(values.argmax()) for _, values in in_shown_units(found)]
    return np.unique([*evenly_spaced(len(found.time)), *worst])


def _rows_of(motion: Trajectory, rows: np.ndarray) -> Trajectory:
    return Trajectory(**{item.name: getattr(motion, item.name)[rows] for item in fields(motion)})
