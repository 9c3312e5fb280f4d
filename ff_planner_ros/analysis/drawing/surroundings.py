"""Obstacles, goal, path constraints and frame axes of a drawn scene."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go
from numpy.typing import NDArray

from ff_planner_ros.analysis.drawing.obstacle_surfaces import (
    obstacle_surface,
    obstacle_words,
    placed,
)
from ff_planner_ros.analysis.drawing.scene_layout import LIT
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.approach import RADIUS_AT_GRASP, Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.path.followed import PathToFollow
from ff_planner_ros.planning.problem.problem import Obstacle, Orientation, Target
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

# More obstacles than the first number are drawn with the coarser circles, more than the last not
# at all but for the nearest: a browser stands still under thousands.
_FEW_OBSTACLES, _MERIDIANS, _COARSE_MERIDIANS, _MOST_OBSTACLES = 20, 24, 8, 100
_OBSTACLE, _GOAL = "#c0392b", "#000000"
# Lines along the corridor of an approach.
_CORRIDOR_SIDES = 12
# Times at which the view of a camera is drawn.
_VIEWS = 3
# Lines that a path to follow is drawn with.
_PATH_LINES = 200
# Of the axes x, y and z.
_AXIS_COLOURS = ("#e41a1c", "#4daf4a", "#377eb8")
# In lengths of the arm: what is further off than this from it would make it small in the picture.
_FAR = 2.0


def near_arm(obstacles: Sequence[Obstacle], times: Array, arms: Array) -> Sequence[Obstacle]:
    """Return the obstacles to draw: the nearest 100 at most, within two arm lengths of the arm.

    Args:
        times: Times of the arm's poses. Shape (poses,) [s].
        arms: Positions of joints and end effector, inertial. Shape (poses, joints + 1, 3) [m].
    """
    length = np.linalg.norm(np.diff(arms[0], axis=0), axis=1).sum()
    around = surroundings(tuple(obstacles))
    away = around.centers(times)[:, None] - arms[:, :, None]
    gaps = (np.linalg.norm(away, axis=-1) - around.radii).min(axis=(0, 1))
    nearest = np.argsort(gaps, kind="stable")[:_MOST_OBSTACLES]
    return [obstacles[k] for k in sorted(nearest) if gaps[k] <= _FAR * length]


def drawn_obstacles(drawn: Sequence[Obstacle], count: int) -> list[go.Mesh3d]:
    """Draw obstacles at time zero; the legend says if they are fewer than all `count`."""
    surfaces = [obstacle_surface(one, _meridians(len(drawn))) for one in drawn]
    left_out = f" (the nearest {len(drawn)} of {count})" if len(drawn) < count else ""
    return [
        go.Mesh3d(
            **xyz(placed(one, corners, np.zeros(1))[0]),
            **dict(zip("ijk", triangles.T, strict=True)),
            color=_OBSTACLE,
            lighting=LIT,
            name=f"obstacles{left_out}",
            legendgroup="obstacles",
            showlegend=number == 0,
            hovertemplate=f"{html.escape(obstacle_words(one))}<extra></extra>",
            flatshading=not one.is_sphere,
        )
        for number, (one, (corners, triangles)) in enumerate(zip(drawn, surfaces, strict=True))
    ]


def obstacle_at(one: Obstacle, time: float, drawn: int) -> dict[str, NDArray[np.floating]]:
    """Return an obstacle's surface points at a time [s], coarser the more obstacles are `drawn`."""
    corners, _ = obstacle_surface(one, _meridians(drawn))
    return xyz(placed(one, corners, np.array([time]))[0])


def drawn_goal(goal: Target, axis_length: float) -> Iterator[go.Scatter3d]:
    """Draw the goal position, and the goal's axes unless its orientation is free."""
    yield go.Scatter3d(
        **xyz(goal.position[None]),
        mode="markers",
        marker={"symbol": "diamond-open", "size": 8, "color": _GOAL},
        name="goal",
        legendgroup="goal",
        hovertemplate="goal<br>%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
    )
    if goal.orientation is not Orientation.FREE:
        axes = 1.5 * axis_length * axes_of(goal.quaternion_xyzw)
        drawn = axis_lines(goal.position, axes, "goal's axes")
        yield drawn.update(name="goal", legendgroup="goal", showlegend=False, line_width=3)


def drawn_constraints(scene: Scene, robot: Robot, motion: Trajectory) -> Iterator[go.Scatter3d]:
    """Draw the path constraints of the end effector; see `constraint_lines`."""
    for name, lines in constraint_lines(scene, robot, motion).items():
        gaps = np.full((len(lines), 1, 3), np.nan)
        yield go.Scatter3d(
            **xyz(np.concatenate([lines, gaps], axis=1).reshape(-1, 3)),
            mode="lines",
            line={"color": _GOAL, "width": 2},
            name=name,
            hovertemplate=f"{name}<extra></extra>",
        )


def constraint_lines(scene: Scene, robot: Robot, motion: Trajectory) -> dict[str, Array]:
    """Return line segments that show a scene's path constraints, by the constraint's field name.

    The corridor of an `approach` is drawn at the goal, the view cone of a `camera` up to the goal,
    at some of the times at which the goal must be in view. A `path` to follow is drawn as a whole.

    Returns:
        Both ends of each line, inertial. Shape (lines, 2, 3) [m].
    """
    found, goal = dict[str, Array](), scene.goal
    if scene.approach is not None and goal is not None:
        found["approach"] = corridor_lines(scene.approach, goal.position, goal.quaternion_xyzw)
    if scene.camera is not None and goal is not None:
        found["camera"] = view_lines(scene.camera, scene, robot, motion)
    if scene.path is not None:
        twist = motion.ee_linear_velocities[0], motion.ee_angular_velocities[0]
        found["path"] = path_lines(scene.path, np.concatenate(twist))
    return found


def path_lines(path: PathToFollow, twist: Array) -> Array:
    """Return line segments of a path, given the end effector's twist at the start; see `curve`.

    Returns:
        Both ends of each line, inertial. Shape (lines, 2, 3) [m].
    """
    times = np.linspace(0.0, path.duration, _PATH_LINES + 1)
    places = path.curve(twist).at(times).positions
    return np.stack([places[:-1], places[1:]], axis=1)


def view_lines(camera: Camera, scene: Scene, robot: Robot, motion: Trajectory) -> Array:
    """Return line segments of a camera's view cone at some times at which it must see the goal.

    Returns:
        Both ends of each line, inertial. Shape (lines, 2, 3) [m].
    """
    end = motion.time[-1] if scene.capture_time is None else scene.capture_time
    times = np.linspace(0.0, end, _VIEWS)
    rows = np.abs(motion.time[:, None] - times).argmin(axis=0)
    goals, (q, _) = scene.targets(motion.time[rows]), from_trajectory(robot, motion)
    frame = robot.model.getFrameId(camera.link, pin.FrameType.BODY)
    data, lines = robot.model.createData(), [np.empty((0, 2, 3))]
    around = np.linspace(0.0, 2 * np.pi, _CORRIDOR_SIDES + 1)
    across = np.linalg.svd(camera.axis[None])[2][1:]
    ring = np.column_stack([np.cos(around), np.sin(around)]) @ across
    edges = math.cos(camera.half_angle) * camera.axis + math.sin(camera.half_angle) * ring
    for row, goal in zip(rows, () if goals is None else goals, strict=False):
        pin.forwardKinematics(robot.model, data, q[row])
        link = pin.updateFramePlacement(robot.model, data, frame)
        eye = link.act(camera.position)
        away = float(np.linalg.norm(goal - eye))
        if away < camera.until:
            continue
        ends = eye + away * edges @ link.rotation.T
        lines.append(np.stack([np.broadcast_to(eye, ends.shape), ends], axis=1)[:-1])
        lines.append(np.stack([ends[:-1], ends[1:]], axis=1))
    return np.concatenate(lines)


def corridor_lines(approach: Approach, position: Array, quaternion_xyzw: Array) -> Array:
    """Return line segments of a corridor's sides and both its ends, for a pose of the grasp.

    Returns:
        Both ends of each line, in the frame of the pose. Shape (lines, 2, 3) [m].
    """
    # Two axes across the direction; any two will do.
    across = np.linalg.svd(approach.direction[None])[2][1:]
    turns = np.linspace(0.0, 2 * np.pi, _CORRIDOR_SIDES + 1)
    ring = np.column_stack([np.cos(turns), np.sin(turns)]) @ across
    narrow = RADIUS_AT_GRASP * ring
    # To where the cone leaves the distance, nearly.
    length = approach.distance * np.cos(approach.half_angle)
    radius = RADIUS_AT_GRASP + length * np.tan(approach.half_angle)
    wide = radius * ring - length * approach.direction
    ends = [np.stack([one[:-1], one[1:]], axis=1) for one in (narrow, wide)]
    lines = np.concatenate([*ends, np.stack([narrow, wide], axis=1)[:-1]])
    turned: Array = position + lines @ rotation_from_quaternion(quaternion_xyzw).T
    return turned


def axis_lines(origin: Array, axes: Array, what: str) -> go.Scatter3d:
    """Draw three axes, x red, y green, z blue; axes: their vectors, a row each [m]."""
    return go.Scatter3d(
        **xyz(axis_points(origin, axes)),
        mode="lines",
        line={"color": [colour for colour in _AXIS_COLOURS for _ in range(3)]},
        hovertemplate=f"{what}: x red, y green, z blue, {what}<br><extra></extra>",
    )


def axis_points(origin: Array, axes: Array) -> Array:
    """Return the points of the lines of three axes, with gaps between them. Shape (9, 3)."""
    return with_gaps([np.array([origin, origin + axis]) for axis in axes])


def with_gaps(lines: Sequence[Array]) -> Array:
    """Return the points of lines in one array, with a row of NaN after each line."""
    gap = np.full((1, 3), np.nan)
    return np.vstack([row for line in lines for row in (line, gap)])


def xyz(points: NDArray[np.floating]) -> dict[str, NDArray[np.floating]]:
    """Return points, shape (points, 3), as plotly takes them."""
    return dict(zip("xyz", points.T, strict=True))


def axes_of(quaternions_xyzw: Array) -> Array:
    """Return the axes of rotated frames as rows, shape (..., 3 axes, 3)."""
    axes: Array = rotation_from_quaternion(quaternions_xyzw).swapaxes(-1, -2)
    return axes


def _meridians(drawn: int) -> int:
    return _MERIDIANS if drawn <= _FEW_OBSTACLES else _COARSE_MERIDIANS
