"""Initial guesses of end-effector paths: detours around an obstacle, and scattered ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.paths.even_normals import even_normals
from ff_planner_ros.planning.paths.outlines import BESIDE, Hit, around_body
from ff_planner_ros.planning.paths.path_family import Motion
from ff_planner_ros.planning.paths.polynomial import COMPONENTS, FREE_TERMS, PARAMETERS
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.robot.model import Robot

# The free term's bump, 1 at the middle of the path, is flat at its ends: an obstacle there is not
# avoided by a huge bump in the middle.
_LEAST_BUMP = 0.3
# Standard deviation of the scattered guesses: wide enough to come to the other side of an obstacle,
# not so wide that most leave the workspace [m, rad].
_SPREAD_POSITION, _SPREAD_ANGLE = 0.3, 0.4


def scattered() -> Iterator[Array]:
    """Yield normally distributed coefficients without end, always the same. Shape (18,)."""
    spread = np.repeat([_SPREAD_POSITION] * 3 + [_SPREAD_ANGLE] * 3, FREE_TERMS)
    for normals in even_normals(PARAMETERS):
        yield normals * spread


def detours(
    robot: Robot, straight: Motion, duration: float, obstacles: Sequence[Obstacle]
) -> Iterator[Array]:
    """Yield coefficients, shape (18,), of four detours around the obstacle that is hit deepest."""
    points = len(straight.q)
    of_spheres = _around_sphere(
        robot, straight, duration, [one for one in obstacles if one.is_sphere]
    )
    of_bodies = around_body(
        robot, straight, duration, [one for one in obstacles if not one.is_sphere]
    )
    hits = [hit for hit in (of_spheres, of_bodies) if hit is not None]
    for hit in sorted(hits, key=lambda hit: -hit.depth)[:1]:
        s = np.linspace(0.0, 1.0, 2 * points - 1)[hit.half_step]
        bump = max(64.0 * s**3 * (1.0 - s) ** 3, _LEAST_BUMP)
        for way in hit.ways:
            coefficients = np.zeros((COMPONENTS, FREE_TERMS))
            coefficients[:3, 0] = way / bump
            yield coefficients.ravel()


def _around_sphere(
    robot: Robot, straight: Motion, duration: float, spheres: Sequence[Obstacle]
) -> Hit | None:
    """Return the detours around the sphere that the lines enter deepest; None: they enter none."""
    positions = arm_points(robot, straight.q)
    times = np.linspace(0.0, duration, len(positions))
    clear = clearances(positions, times, segments(positions), spheres)
    if clear.distance.min(initial=np.inf) >= 0.0:
        return None
    deepest = np.unravel_index(clear.distance.argmin(), clear.distance.shape)
    out = clear.direction[deepest]
    sphere, depth = spheres[int(deepest[2])], -clear.distance[deepest]
    radius = sphere.radius
    # Across the end effector's motion relative to the sphere.
    way = sphere.motion.way(duration)
    aside = np.cross(out, positions[-1, -1] - positions[0, -1] - way)
    aside /= max(float(np.linalg.norm(aside)), 1e-9)
    ways = (
        out * (depth + BESIDE),
        aside * (radius + BESIDE),
        -aside * (radius + BESIDE),
        -out * (2.0 * radius - depth + BESIDE),
    )
    return Hit(float(depth), 2 * int(deepest[0]), ways)
