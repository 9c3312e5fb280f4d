"""A shaded still picture of a plan's scene: the robot at start and end, and the obstacles."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ff_planner_ros.analysis.drawing.obstacle_surfaces import obstacle_surface, placed
from ff_planner_ros.analysis.drawing.solids import robot_surface, surface_at
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem

_ROBOT, _OBSTACLE, _GHOST = "#4c86b8", "#c9a24a", "#9fb4c6"
_GHOST_ALPHA = 0.12
_AROUND = 24  # corners of a circle
# Towards the light, and how bright what it does not reach is.
_LIGHT, _SHADE = np.array([-0.4, -0.7, 0.6]), 0.35
# What lies behind is drawn first, by the middles of triangles: none may be longer [m].
_LONGEST = 0.12
_ELEVATION, _AZIMUTH = 22.0, -142.0  # of who looks on [deg]


def lit_scene(problem: PlanningProblem, motion: Trajectory) -> Figure:
    """Draw robot and obstacles at the end of a motion, and, translucent, the robot at its start."""
    q = from_trajectory(problem.robot, motion)[0]
    end = float(motion.time[-1])
    surface = robot_surface(problem.robot)
    at_start, at_end = surface_at(problem.robot, surface, q[[0, -1]])[:, surface.triangles]
    opaque = [_lit(_small(at_end), _ROBOT)]
    for one in problem.obstacles:
        own, triangles = obstacle_surface(one, _AROUND)
        (points,) = placed(one, own, np.array([end]))
        opaque.append(_lit(_small(points[triangles]), _OBSTACLE))
    ghost, colours = _lit(_small(at_start), _GHOST)
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    axes.add_collection3d(
        Poly3DCollection(
            ghost, facecolors=colours, linewidths=0.0, alpha=_GHOST_ALPHA, rasterized=True
        )
    )
    every = np.concatenate([triangles for triangles, _ in opaque])
    colours = np.concatenate([colours for _, colours in opaque])
    axes.add_collection3d(
        # With edges of their own colour, or else there are seams between triangles.
        Poly3DCollection(
            every, facecolors=colours, edgecolors=colours, linewidths=0.3, rasterized=True
        )
    )
    every = np.concatenate([every, ghost])
    low, high = every.min(axis=(0, 1)), every.max(axis=(0, 1))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.2)
    axes.view_init(_ELEVATION, _AZIMUTH)
    axes.set_axis_off()
    return figure


def _small(triangles: Array) -> Array:
    """Return triangles, bisected until no edge is long. Shape (triangles, 3 corners, 3) [m]."""
    done = [np.empty((0, 3, 3))]
    while len(triangles):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = edges.max(axis=1) > _LONGEST
        done.append(triangles[~long])
        # The longest edge is from the first corner to the second.
        first = edges[long].argmax(axis=1)[:, None] + np.arange(3)
        a, b, c = np.moveaxis(np.take_along_axis(triangles[long], first[:, :, None] % 3, 1), 1, 0)
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
    return np.concatenate(done)


def _lit(triangles: Array, colour: str) -> tuple[Array, Array]:
    """Return triangles and the colours of both their sides, shape (triangles, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    bright = _SHADE + (1.0 - _SHADE) * np.abs(normals @ light) / lengths
    return triangles, np.outer(bright, to_rgb(colour))
