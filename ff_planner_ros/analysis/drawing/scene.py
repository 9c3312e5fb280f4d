"""A scene in a browser: obstacles, chaser, arm and their paths, with a time slider.

Plotly draws it, because one HTML file then holds everything, without server or network, and its
legend shows and hides each method.
"""

from __future__ import annotations

import html
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.scene_layout import (
    LIT,
    add_controls,
    add_turns,
    lay_out,
    save_page,
)
from ff_planner_ros.analysis.drawing.solids import RobotSurface, robot_surface, surface_at
from ff_planner_ros.analysis.drawing.surroundings import (
    axes_of,
    axis_lines,
    axis_points,
    drawn_constraints,
    drawn_goal,
    drawn_obstacles,
    near_arm,
    obstacle_at,
    with_gaps,
    xyz,
)
from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.analysis.nearest import Nearest, nearest
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem, Target
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.robot.collision.box import uniform_box
from ff_planner_ros.robot.model import Robot

# Enough for the eye; the file grows with each, which holds all methods.
_MOST_FRAMES = 50
# Number of times at which the arm is drawn along its path.
_SNAPSHOTS = 5
# Length of drawn axes beside the arm's.
_AXIS_LENGTH = 0.1
_NEAREST = "#d40000"


def save_scene(
    problem: PlanningProblem,
    motions: Mapping[Method, Trajectory],
    shown: Collection[Method],
    path: Path,
) -> None:
    """Write the scene of `scene_figure` as one HTML file that needs nothing else."""
    first = next(iter(motions.values()))
    goal = problem.target
    if problem.posture is not None:  # it has no place: where the end effector comes is shown
        goal = Target(first.ee_positions[-1], first.ee_quaternions_xyzw[-1])
    allowed = problem.allowed_collisions
    figure = scene_figure(problem.robot, problem.obstacles, goal, motions, shown, allowed)
    figure.add_traces(list(drawn_constraints(scene_of(problem), problem.robot, first)))
    save_page(figure, ", ".join(method.label for method in motions), path)


def scene_figure(
    robot: Robot,
    obstacles: Sequence[Obstacle],
    goal: Target,
    motions: Mapping[Method, Trajectory],
    shown: Collection[Method],
    may_touch: Collection[str] = (),
    controls: bool = True,
) -> go.Figure:
    """Draw the scene: Fig. 2 of the paper, for several methods and all times.

    Args:
        shown: Methods whose paths are shown from the start; a click in the legend shows the
            others. The robot is that of the first; buttons show the others in turn.
        may_touch: Pairs left out of the marked minimum distance, named as in `allowed_collisions`.
        controls: Whether the figure has a slider and buttons of its own.
    """
    longest = max((motion.time for motion in motions.values()), key=lambda time: float(time[-1]))
    times = np.linspace(0.0, longest[-1], min(len(longest), _MOST_FRAMES))
    surface = robot_surface(robot)
    drawn = [
        _motion(robot, obstacles, may_touch, surface, method, trajectory, times)
        for method, trajectory in motions.items()
    ]
    snapshots = drawn[0].snapshots
    near = near_arm(
        obstacles, next(iter(motions.values())).time[snapshots], drawn[0].arm[snapshots]
    )
    figure = go.Figure(
        [*drawn_obstacles(near, len(obstacles)), *drawn_goal(goal, drawn[0].axis_length)]
    )
    passing = [one for one in near if one.moves]
    moving = [number for number, one in enumerate(near) if one.moves]
    first, robots = next(one for one in motions if one in shown), dict[Method, list[int]]()
    for motion in drawn:
        bodies = list(_bodies(motion))
        robots[motion.method] = [len(figure.data) + k for k in range(len(bodies))]
        moving += robots[motion.method]
        for trace in bodies:  # one robot at a time: two would lie in each other
            trace.visible = motion.method == first
        paths = [*_paths(motion), *_nearest(motion)]
        for trace in paths:
            trace.visible = True if motion.method in shown else "legendonly"
        figure.add_traces([*bodies, *paths])
    # As many digits as tell two frames apart.
    digits = 2 if len(times) < 2 else max(2, 1 - int(np.floor(np.log10(times[1]))))
    figure.frames = [
        {
            "name": f"{time:.{digits}f}",
            "data": [
                *({"type": "mesh3d", **obstacle_at(one, time, len(near))} for one in passing),
                *({"type": of, **xyz(at)} for motion in drawn for of, at in _places(motion, frame)),
            ],
            "traces": moving,
        }
        for frame, time in enumerate(times.tolist())
    ]
    lay_out(figure)
    if len(drawn) > 1:
        add_turns(figure, {method.label: rows for method, rows in robots.items()}, first.label)
    if controls:
        add_controls(figure)
    return figure


@dataclass(frozen=True, eq=False)
class _Motion:
    """One method's motion in points of the inertial frame."""

    method: Method
    chaser: Array  # centre of mass; shape (points, 3)
    box: Array  # corners of the chaser's box; shape (points, 8, 3)
    boxed: bool  # whether it is drawn: a chaser with bodies needs none
    arm: Array  # joints and end effector; shape (points, joints + 1, 3)
    axes: Array  # of the end effector, unit length; shape (points, 3 axes, 3)
    surface: Array  # corners of the links' shapes; shape (frames, corners, 3)
    triangles: NDArray[np.intp]  # of them; shape (triangles, 3)
    nearest: Nearest | None  # where bodies come nearest to each other or to an obstacle
    rows: NDArray[np.intp]  # the point that each frame shows; shape (frames,)

    @property
    def snapshots(self) -> NDArray[np.intp]:
        """Points at which the arm is drawn along its way."""
        return np.linspace(0, len(self.arm) - 1, _SNAPSHOTS).round().astype(np.intp)

    @property
    def axis_length(self) -> float:
        """Length of drawn axes [m]."""
        links = np.diff(self.arm[0], axis=0)
        return _AXIS_LENGTH * float(np.linalg.norm(links, axis=1).sum())


def _motion(
    robot: Robot,
    obstacles: Sequence[Obstacle],
    may_touch: Collection[str],
    surface: RobotSurface,
    method: Method,
    trajectory: Trajectory,
    times: Array,
) -> _Motion:
    q, _ = from_trajectory(robot, trajectory)
    turns = Rotation.from_quat(trajectory.chaser_quaternions_xyzw).as_matrix()
    box, signs = uniform_box(robot), np.array(list(product((-0.5, 0.5), repeat=3)))
    corners = np.einsum("pij,cj->pci", turns, (signs * box.edges) @ box.rotation_box_to_chaser.T)
    rows = np.abs(trajectory.time[:, None] - times).argmin(axis=0)
    return _Motion(
        method=method,
        chaser=trajectory.chaser_positions,
        box=trajectory.chaser_positions[:, None] + corners,
        boxed=not any(body.joint == 1 for body in robot.bodies),
        arm=arm_points(robot, q),
        axes=axes_of(trajectory.ee_quaternions_xyzw),
        surface=surface_at(robot, surface, q[rows]),
        triangles=surface.triangles,
        nearest=nearest(robot, trajectory, obstacles, may_touch),
        rows=rows,
    )


# Corners of the box that an edge joins: those that differ in one sign.
_EDGES = [(a, b) for a, b in combinations(range(8), 2) if (a ^ b).bit_count() == 1]


def _places(motion: _Motion, frame: int) -> Iterator[tuple[str, NDArray[np.floating]]]:
    """Yield kind and points, shape (points, 3), of what moves, as `_bodies` draws it.

    A figure has hundreds of frames, of which each object of plotly's would be checked.
    """
    point = motion.rows[frame]
    yield "scatter3d", with_gaps(_of_chaser(motion, frame))
    yield "scatter3d", with_gaps([motion.arm[point]])
    yield "scatter3d", axis_points(motion.arm[point, -1], motion.axis_length * motion.axes[point])
    if motion.surface.size:
        yield "mesh3d", motion.surface[frame].astype(np.float32)


def _of_chaser(motion: _Motion, frame: int) -> list[Array]:
    """Return the chaser's lines: edges of its box, and centre of mass to first joint."""
    point = motion.rows[frame]
    edges = [motion.box[point][list(edge)] for edge in _EDGES] if motion.boxed else []
    return [*edges, np.array([motion.chaser[point], motion.arm[point, 0]])]


def _bodies(motion: _Motion) -> Iterator[go.Scatter3d | go.Mesh3d]:
    """Draw what moves: chaser, arm, end effector's axes, and the links where they have shapes."""
    arm = motion.arm[motion.rows[0]]
    yield _lines(motion.method, "chaser", _of_chaser(motion, 0), width=3)
    yield _lines(motion.method, "arm", [arm], width=9, marker_size=4)
    of_axes = motion.axis_length * motion.axes[motion.rows[0]]
    axes = axis_lines(arm[-1], of_axes, "end effector's axes")
    yield axes.update(
        name=motion.method.label, legendgroup=motion.method.name, showlegend=False, line_width=7
    )
    if motion.surface.size:
        yield go.Mesh3d(
            **xyz(motion.surface[0].astype(np.float32)),
            **dict(zip("ijk", motion.triangles.T, strict=True)),
            color=motion.method.colour,
            lighting=LIT,
            flatshading=True,
            name=motion.method.label,
            legendgroup=motion.method.name,
            showlegend=False,
            hovertemplate=f"{motion.method.label}, links<br><extra></extra>",
        )


def _paths(motion: _Motion) -> tuple[go.Scatter3d, ...]:
    """Draw the ways of end effector and chaser, and the arm at a few times on its way."""
    arms = _lines(motion.method, "arm on its way", list(motion.arm[motion.snapshots]), width=4)
    return (
        _lines(motion.method, "end effector", [motion.arm[:, -1]], width=6, showlegend=True),
        _lines(motion.method, "chaser's way", [motion.chaser], width=6),
        arms.update(opacity=0.35),
    )


def _nearest(motion: _Motion) -> Iterator[go.Scatter3d]:
    """Mark where bodies come nearest to each other or to an obstacle."""
    if motion.nearest is not None:
        yield go.Scatter3d(
            **xyz(motion.nearest.ends),
            mode="lines+markers",
            line={"color": _NEAREST, "width": 8},
            marker={"color": _NEAREST, "size": 4, "symbol": "diamond"},
            name=f"nearest, {motion.nearest.distance * 1e3:.1f} mm",
            legendgroup=motion.method.name,
            hovertemplate=f"{html.escape(motion.nearest.words)}<extra></extra>",
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
    return go.Scatter3d(
        **xyz(with_gaps(lines)),
        mode="lines+markers" if marker_size else "lines",
        line={"color": method.colour, "width": width},
        marker={"color": method.colour, "size": marker_size},
        name=method.label,
        legendgroup=method.name,
        showlegend=showlegend,
        hovertemplate=f"{method.label}, {what}<br>%{{x:.3f}}, %{{y:.3f}}, %{{z:.3f}} m"
        "<extra></extra>",
    )
