"""Interactive 3-D view of a scenario before planning: robot at the start, tool at the goal.

A slider moves the obstacles, and those fixed to a target body, through the duration.
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go

from ff_planner_ros.analysis.drawing.scene_layout import add_controls, lay_out
from ff_planner_ros.analysis.drawing.solids import Triangles, robot_surface, surface_at, surface_of
from ff_planner_ros.analysis.drawing.surroundings import (
    drawn_goal,
    drawn_obstacles,
    near_arm,
    obstacle_at,
    xyz,
)
from ff_planner_ros.analysis.scene_distances import Gap, tool_at_goal
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem
from ff_planner_ros.robot.configuration import configuration

_FRAMES = 25
_ROBOT, _TOOL, _NEAREST = "#0072b2", "#009e73", "#d40000"
# Length of drawn axes beside the arm's, and corners of a circle.
_AXIS_LENGTH, _AROUND = 0.1, 12


def figure_before_plan(
    problem: PlanningProblem, start: Sequence[Gap], goal: Sequence[Gap]
) -> go.Figure:
    """Draw a scenario with the smallest distances at its start and goal.

    Args:
        start: As `gaps_at_start` returns; the first is drawn.
        goal: As `gaps_at_goal` returns; the first is drawn.
    """
    robot = problem.robot
    q, _ = configuration(robot, problem.start)
    arm = arm_points(robot, q[None])
    times = np.linspace(0.0, problem.duration, _FRAMES)
    ends = np.array([0.0, problem.duration])
    near = near_arm(problem.obstacles, ends, np.repeat(arm, 2, axis=0))
    length = float(np.linalg.norm(np.diff(arm[0], axis=0), axis=1).sum())
    figure = go.Figure(list(drawn_obstacles(near, len(problem.obstacles))))
    moving = [number for number, one in enumerate(near) if one.moves]
    surface = robot_surface(robot)
    if surface.corners.size:
        corners = surface_at(robot, surface, q[None])[0]
        figure.add_trace(_mesh(corners, surface.triangles, _ROBOT, "robot at the start"))
    figure.add_trace(
        go.Scatter3d(
            **xyz(arm[0]),
            mode="lines+markers",
            line={"color": "black", "width": 5},
            marker={"color": "black", "size": 3},
            name="arm at the start",
        )
    )
    figure.add_traces(list(drawn_goal(problem.target, _AXIS_LENGTH * length)))
    if problem.target.orientation is Orientation.FIXED and robot.bodies:
        for body, place in tool_at_goal(problem):
            corners, triangles = surface_of(body.solid, _AROUND)
            figure.add_trace(_mesh(_at(place, corners), triangles, _TOOL, "tool at the goal"))
    figure.add_traces([*_drawn_gap(start, "start"), *_drawn_gap(goal, "goal")])
    figure.frames = [
        {
            "name": f"{time:.2f}",
            "data": [
                {"type": "mesh3d", **obstacle_at(near[number], time, len(near))}
                for number in moving
            ],
            "traces": moving,
        }
        for time in times.tolist()
        if moving
    ]
    lay_out(figure)
    if moving:
        add_controls(figure)
    return figure


def _drawn_gap(gaps: Sequence[Gap], where: str) -> Iterator[go.Scatter3d]:
    for gap in gaps[:1]:
        words = f"{gap.body}/{gap.other}, {gap.distance * 1e3:.1f} mm at the {where}"
        yield go.Scatter3d(
            **xyz(gap.ends),
            mode="lines+markers",
            line={"color": _NEAREST, "width": 8},
            marker={"color": _NEAREST, "size": 4, "symbol": "diamond"},
            name=html.escape(words),
            hovertemplate=f"{html.escape(words)}<extra></extra>",
        )


def _at(place: pin.SE3, corners: Array) -> Array:
    return np.asarray(corners @ place.rotation.T + place.translation, np.float64)


def _mesh(corners: Array, triangles: Triangles, colour: str, name: str) -> go.Mesh3d:
    return go.Mesh3d(
        **xyz(corners.astype(np.float32)),
        **dict(zip("ijk", triangles.T, strict=True)),
        color=colour,
        opacity=0.5,
        flatshading=True,
        name=name,
        showlegend=True,
        hovertemplate=f"{name}<extra></extra>",
    )
