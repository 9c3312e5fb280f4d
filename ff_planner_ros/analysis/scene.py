"""A scene in a browser: obstacles, chaser, arm and their paths, with a time slider.

Plotly draws it, because one HTML file then holds everything, without server or network, and its
legend shows and hides each method.
"""

from __future__ import annotations

import html
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.planning.problem import PlanningProblem, Sphere
from ff_planner_ros.robot.box import uniform_box
from ff_planner_ros.robot.model import Robot

# Enough for the eye; the file grows with each, which holds all methods.
_MOST_FRAMES = 50
_FRAME_DURATION = 100  # [ms] on the screen
# Number of times at which the arm is drawn along its path.
_SNAPSHOTS = 5
_MERIDIANS = 24
_OBSTACLE, _GOAL = "#c0392b", "#000000"
_PAGE = (
    '<!doctype html><html><head><meta charset="utf-8"><title>{title}</title>'
    "<style>body {{margin: 0}}</style></head><body>{element}</body></html>\n"
)
_CAMERA = {"eye": {"x": -0.9, "y": -1.75, "z": 0.8}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}


def save_scene(
    problem: PlanningProblem,
    motions: Mapping[Method, Trajectory],
    shown: Collection[Method],
    path: Path,
) -> None:
    """Write the scene of `scene_figure` as one HTML file that needs nothing else."""
    # The name of the scene's element is fixed: the same motions give the same file.
    goal = problem.target.position
    element = scene_figure(problem.robot, problem.obstacles, goal, motions, shown).to_html(
        full_html=False,
        include_plotlyjs=True,
        auto_play=False,
        default_height="100vh",
        div_id="scene",
        config={"displaylogo": False},
    )
    path.write_text(
        _PAGE.format(title=", ".join(m.label for m in motions), element=element), "utf-8"
    )


def scene_figure(
    robot: Robot,
    obstacles: Sequence[Sphere],
    goal: Array,
    motions: Mapping[Method, Trajectory],
    shown: Collection[Method],
) -> go.Figure:
    """Draw the scene: Fig. 2 of the paper, for several methods and all times.

    Args:
        goal: Of the end effector, in the inertial frame. Shape (3,) [m].
        shown: Methods that are shown from the start; a click in the legend shows the others.
    """
    drawn = [_motion(robot, method, trajectory) for method, trajectory in motions.items()]
    figure = go.Figure([*_obstacles(obstacles), _goal(goal)])
    passing = [sphere for sphere in obstacles if sphere.velocity.any()]
    moving = [number for number, sphere in enumerate(obstacles) if sphere.velocity.any()]
    for motion in drawn:
        traces = [*_bodies(motion, 0), *_paths(motion)]
        moving += [len(figure.data), len(figure.data) + 1]
        for trace in traces:
            trace.visible = True if motion.method in shown else "legendonly"
        figure.add_traces(traces)
    longest = max(drawn, key=lambda motion: float(motion.time[-1])).time
    times = np.linspace(0.0, longest[-1], min(len(longest), _MOST_FRAMES))
    figure.frames = [
        go.Frame(
            name=f"{time:.2f}",
            data=[
                *({"type": "mesh3d", **_surface(sphere, time)} for sphere in passing),
                *(
                    {axis: getattr(trace, axis) for axis in "xyz"} | {"type": "scatter3d"}
                    for motion in drawn
                    for trace in _bodies(motion, int(np.abs(motion.time - time).argmin()))
                ),
            ],
            traces=moving,
        )
        for time in times
    ]
    _lay_out(figure)
    return figure


@dataclass(frozen=True, eq=False)
class _Motion:
    """One method's motion in points of the inertial frame."""

    method: Method
    time: Array  # shape (points,)
    chaser: Array  # centre of mass; shape (points, 3)
    box: Array  # corners of the chaser's box; shape (points, 8, 3)
    arm: Array  # joints and end effector; shape (points, joints + 1, 3)


def _motion(robot: Robot, method: Method, trajectory: Trajectory) -> _Motion:
    q, _ = from_trajectory(robot, trajectory)
    turns = Rotation.from_quat(trajectory.chaser_quaternions_xyzw).as_matrix()
    box, signs = uniform_box(robot), np.array(list(product((-0.5, 0.5), repeat=3)))
    corners = np.einsum("pij,cj->pci", turns, (signs * box.edges) @ box.rotation_box_to_chaser.T)
    return _Motion(
        method=method,
        time=trajectory.time,
        chaser=trajectory.chaser_positions,
        box=trajectory.chaser_positions[:, None] + corners,
        arm=arm_points(robot, q),
    )


# Corners of the box that an edge joins: those that differ in one sign.
_EDGES = [(a, b) for a, b in combinations(range(8), 2) if (a ^ b).bit_count() == 1]


def _bodies(motion: _Motion, point: int) -> tuple[go.Scatter3d, go.Scatter3d]:
    """Draw the chaser, its box with a line to the first joint, and the arm."""
    box, arm = motion.box[point], motion.arm[point]
    edges = [box[list(edge)] for edge in _EDGES]
    mount = np.array([motion.chaser[point], arm[0]])
    return (
        _lines(motion.method, "chaser", [*edges, mount], width=3),
        _lines(motion.method, "arm", [arm], width=9, marker_size=4),
    )


def _paths(motion: _Motion) -> tuple[go.Scatter3d, ...]:
    """Draw the ways of end effector and chaser, and the arm at a few times on its way."""
    snapshots = np.linspace(0, len(motion.time) - 1, _SNAPSHOTS).round().astype(int)
    arms = _lines(motion.method, "arm on its way", list(motion.arm[snapshots]), width=4)
    return (
        _lines(motion.method, "end effector", [motion.arm[:, -1]], width=6, showlegend=True),
        _lines(motion.method, "chaser's way", [motion.chaser], width=6),
        arms.update(opacity=0.35),
    )


def _lines(
    method: Method,
    what: str,
    lines: Sequence[Array],
    width: float,
    marker_size: float = 0.0,
    showlegend: bool = False,
) -> go.Scatter3d:
    """Draw lines as one trace, with gaps between them."""
    gap = np.full((1, 3), np.nan)
    return go.Scatter3d(
        **_xyz(np.vstack([row for line in lines for row in (line, gap)])),
        mode="lines+markers" if marker_size else "lines",
        line={"color": method.colour, "width": width},
        marker={"color": method.colour, "size": marker_size},
        name=method.label,
        legendgroup=method.name,
        showlegend=showlegend,
        hovertemplate=f"{method.label}, {what}<br>%{{x:.3f}}, %{{y:.3f}}, %{{z:.3f}} m"
        "<extra></extra>",
    )


def _xyz(points: Array) -> dict[str, Array]:
    """Return points, shape (points, 3), as plotly takes them."""
    return dict(zip("xyz", points.T, strict=True))


def _obstacles(obstacles: Sequence[Sphere]) -> list[go.Mesh3d]:
    _, triangles = _unit_sphere()
    return [
        go.Mesh3d(
            **_surface(sphere, 0.0),
            **dict(zip("ijk", triangles.T, strict=True)),
            color=_OBSTACLE,
            opacity=0.55,
            name="obstacles",
            legendgroup="obstacles",
            showlegend=number == 0,
            hovertemplate=f"{html.escape(sphere.id)}, radius {sphere.radius:g} m<extra></extra>",
        )
        for number, sphere in enumerate(obstacles)
    ]


def _surface(sphere: Sphere, time: float) -> dict[str, Array]:
    """Return the points of a sphere's surface at a time [s]."""
    corners, _ = _unit_sphere()
    return _xyz(sphere.center + time * sphere.velocity + sphere.radius * corners)


def _unit_sphere() -> tuple[Array, Any]:
    """Return corners, shape (corners, 3), and triangles of them, shape (triangles, 3)."""
    parallels = _MERIDIANS // 2
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, np.pi, parallels + 1),
        np.linspace(0.0, 2 * np.pi, _MERIDIANS, endpoint=False),
        indexing="ij",
    )
    sphere = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    corners = np.stack(sphere, axis=-1).reshape(-1, 3)
    row, column = np.divmod(np.arange(parallels * _MERIDIANS), _MERIDIANS)
    here, right = row * _MERIDIANS + column, row * _MERIDIANS + (column + 1) % _MERIDIANS
    below, below_right = here + _MERIDIANS, right + _MERIDIANS
    upper, lower = np.stack([here, below, right], 1), np.stack([right, below, below_right], 1)
    return corners, np.concatenate([upper, lower])


def _goal(position: Array) -> go.Scatter3d:
    return go.Scatter3d(
        **_xyz(position[None]),
        mode="markers",
        marker={"symbol": "diamond-open", "size": 8, "color": _GOAL},
        name="goal",
        hovertemplate="goal<br>%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
    )


def _lay_out(figure: go.Figure) -> None:
    """Fix axes and camera, so that only the robot moves, and add the controls."""
    drawn = [*figure.data, *(trace for frame in figure.frames for trace in frame.data)]
    points = np.hstack([[np.asarray(trace[axis], float) for axis in "xyz"] for trace in drawn])
    low, high = np.nanmin(points, axis=1), np.nanmax(points, axis=1)
    margin = 0.05 * (high - low).max()
    spans = high - low + 2 * margin
    axes = {
        f"{axis}axis": {
            "title": {"text": f"{axis} [m]"},
            "range": [low[k] - margin, high[k] + margin],
            "backgroundcolor": "#f7f7f7",
            "gridcolor": "#dddddd",
            "zerolinecolor": "#bbbbbb",
        }
        for k, axis in enumerate("xyz")
    }
    ratio = dict(zip("xyz", (spans / np.cbrt(spans.prod())).tolist(), strict=True))
    play = {"frame": {"duration": _FRAME_DURATION, "redraw": True}, "fromcurrent": True}
    stop = {"frame": {"duration": 0, "redraw": True}, "mode": "immediate"}
    figure.update_layout(
        scene={
            **axes,
            "aspectmode": "manual",
            "aspectratio": ratio,
            "camera": _CAMERA,
            "domain": {"y": [0.14, 1.0]},
            "uirevision": "kept",
        },
        uirevision="kept",
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"x": 0.01, "y": 0.99, "bgcolor": "rgba(255, 255, 255, 0.7)"},
        updatemenus=[
            {
                "type": "buttons",
                "direction": "left",
                "x": 0.01,
                "y": 0.12,
                "xanchor": "left",
                "yanchor": "top",
                "buttons": [
                    {"label": "▶", "method": "animate", "args": [None, play]},
                    {"label": "❚❚", "method": "animate", "args": [[None], stop]},
                ],
            }
        ],
        sliders=[
            {
                "x": 0.12,
                "len": 0.86,
                "y": 0.14,
                "currentvalue": {"prefix": "time ", "suffix": " s"},
                "steps": [
                    {"label": frame.name, "method": "animate", "args": [[frame.name], stop]}
                    for frame in figure.frames
                ],
            }
        ],
    )
