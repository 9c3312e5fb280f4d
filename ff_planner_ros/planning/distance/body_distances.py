"""Signed distances of the robot's bodies from each other and from obstacles, with derivatives.

Coal measures solids; the distance of a sphere from a ball, capsule, box or cylinder has a closed
form, so that a thousand spheres are cheap. The check uses these, the search the core.
Places and axes are in the base frame.
"""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import (
    Placed,
    carries,
    centers_in_base,
    kinds_and_sizes,
    pairs,
    radii,
)
from ff_planner_ros.planning.distance.solids_apart import (
    FORMULAS,
    Distances,
    Solids,
    from_hull,
    solids_apart,
)
from ff_planner_ros.planning.distance.surroundings import Poses, Surroundings
from ff_planner_ros.robot.collision.primitives import Kind
from ff_planner_ros.robot.model import Robot


def pair_bounds(robot: Robot, placed: Placed) -> Array:
    """Return lower bounds of the distances of pairs, by bounding spheres.

    Shape (configurations, pairs) [m].
    """
    (first, second), around = pairs(robot), radii(robot)
    apart = np.linalg.norm(placed.centers[:, first] - placed.centers[:, second], axis=-1)
    bounds: Array = apart - around[first] - around[second]
    return bounds


def pair_distances(robot: Robot, placed: Placed, rows: tuple[Indices, ...]) -> Distances:
    """Measure pairs of bodies; rows: configurations and pair numbers, each of shape (rows,)."""
    at, numbers = rows
    first, second = (_bodies_at(robot, placed, at, side[numbers]) for side in pairs(robot))
    return solids_apart(first, second)


def _bodies_at(robot: Robot, placed: Placed, at: Indices, bodies: Indices) -> Solids:
    """Return the body of each row, at its configuration."""
    found = Solids(
        [robot.bodies[body].solid for body in bodies.tolist()],
        placed.rotations[at, bodies],
        placed.positions[at, bodies],
        placed.centers[at, bodies],
        radii(robot)[bodies],
    )
    for row in np.flatnonzero(placed.stretches[at, bodies].any(axis=1)).tolist():
        stretch = placed.stretches[at[row], bodies[row]]
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), stretch)
        found.solids[row] = coal.Capsule(0.0, float(np.linalg.norm(stretch)))
        found.rotations[row], found.positions[row] = turn.toRotationMatrix(), found.centers[row]
    return found


def obstacle_bounds(
    robot: Robot, placed: Placed, q: Array, times: Array, around: Surroundings
) -> Array:
    """Return lower bounds of the distances of bodies from obstacles, by bounding spheres.

    Args:
        q: Shape (configurations, 7 + joints).
        times: From the plan's first point on. Shape (configurations,) [s].

    Returns:
        Shape (configurations, bodies, obstacles) [m].
    """
    centers = centers_in_base(q, around.centers(times))
    apart = np.linalg.norm(placed.centers[:, :, None] - centers[:, None], axis=-1)
    bounds: Array = apart - radii(robot)[:, None] - around.radii
    return bounds


def obstacle_distances(
    robot: Robot,
    placed: Placed,
    there: Poses,
    around: Surroundings,
    rows: tuple[Indices, ...],
) -> Distances:
    """Measure bodies against obstacles.

    Args:
        there: Poses of the obstacle of each row, in the base frame.
        rows: Configurations, bodies and obstacles, each of shape (rows,).
    """
    count = len(rows[0])
    found = Distances(np.empty(count), np.empty((count, 3)), np.empty((count, 3)))
    are_spheres = around.are_spheres[rows[2]]
    for which, measure in (
        (np.flatnonzero(are_spheres), _from_spheres),
        (np.flatnonzero(~are_spheres), _from_solids),
    ):
        if not which.size:
            continue
        some = Poses(*(each[which] for each in there)), around, tuple(each[which] for each in rows)
        for every, part in zip(found, measure(robot, placed, *some), strict=True):
            every[which] = part
    return found


def _from_spheres(
    robot: Robot,
    placed: Placed,
    there: Poses,
    around: Surroundings,
    rows: tuple[Indices, ...],
) -> Distances:
    """Measure bodies against spheres, by formulas where there are any."""
    configuration, body, sphere = rows
    to_base, begin = placed.rotations[configuration, body], placed.positions[configuration, body]
    away, stretch = there.positions - begin, placed.stretches[configuration, body]
    if stretch.any():
        along = np.einsum("ri,ri->r", stretch, stretch)
        part = np.einsum("ri,ri->r", away, stretch) / np.maximum(along, np.finfo(float).tiny)
        away = away - np.clip(part, 0.0, 1.0)[:, None] * stretch
    seen = np.einsum("rji,rj->ri", to_base, away)
    distance, out = np.empty(len(seen)), np.empty((len(seen), 3))
    kinds, sizes = kinds_and_sizes(robot)
    for kind in Kind:
        of_kind = np.flatnonzero(kinds[body] == kind)
        if of_kind.size and kind in FORMULAS:
            found = FORMULAS[kind](seen[of_kind], sizes[body[of_kind]])
            distance[of_kind], out[of_kind] = found
        for row in of_kind if kind not in FORMULAS else ():
            distance[row], out[row] = from_hull(robot.bodies[body[row]].solid, seen[row])
    normal = np.einsum("rij,rj->ri", to_base, out)
    return Distances(distance - around.radii[sphere], there.positions, normal)


def _from_solids(
    robot: Robot,
    placed: Placed,
    there: Poses,
    around: Surroundings,
    rows: tuple[Indices, ...],
) -> Distances:
    """Measure bodies against other obstacles, by Coal."""
    at, bodies, numbers = rows
    solids = [around.obstacles[number].solid for number in numbers.tolist()]
    offsets = np.reshape([solid.center for solid in solids], (-1, 3))
    centers = there.positions + np.einsum("rij,rj->ri", there.rotations, offsets)
    geometries = [solid.geometry for solid in solids]
    obstacles = Solids(geometries, *there, centers, around.radii[numbers])
    return solids_apart(_bodies_at(robot, placed, at, bodies), obstacles)


def pair_gradients(
    robot: Robot, placed: Placed, found: Distances, rows: tuple[Indices, ...]
) -> Array:
    """Return the derivatives of `pair_distances` by the joint angles. Shape (rows, joints).

    Only joints that move one of two bodies alone move it against the other.
    """
    first, second = (carries(robot)[:, side[rows[1]]].T for side in pairs(robot))
    turned = _turned(placed, found, rows[0])
    return robot.tree.by_planned(turned * (second - first))


def obstacle_gradients(
    robot: Robot, placed: Placed, found: Distances, rows: tuple[Indices, ...]
) -> Array:
    """Return the derivatives of `obstacle_distances` by base and joints. Shape (rows, 6 + joints).

    Those by the base are by its tangent, linear part first, in base axes.
    """
    moved = -_turned(placed, found, rows[0]) * carries(robot)[:, rows[1]].T
    # Seen from a base that moves, a centre moves the other way.
    by_turn = -np.cross(found.point, found.normal)
    return np.hstack([-found.normal, by_turn, robot.tree.by_planned(moved)])


def _turned(placed: Placed, found: Distances, configurations: Indices) -> Array:
    """Return how fast each joint moves what it carries along the normal. Shape (rows, all)."""
    lever = found.point[:, None] - placed.origins[configurations]
    moved = np.cross(placed.axes[configurations], lever) + placed.slides[configurations]
    along: Array = np.einsum("rji,ri->rj", moved, found.normal)
    return along
