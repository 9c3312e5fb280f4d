"""Certified distances for the search, by the compiled core; the check never uses them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, obstacles_of, spheres_of
from ff_planner_ros.planning.distance.body_motion import body_ways, cubics_of, pair_ways
from ff_planner_ros.planning.distance.certificate import (
    CERTIFICATE_GAP,
    cubics_between,
    slides,
    way_bounds,
)
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.robot.model import Robot


def search_certificate(
    robot: Robot,
    q: Array,
    v: Array,
    times: Array,
    spheres: Sequence[Obstacle],
    gap: float = CERTIFICATE_GAP,
    part: float = 0.0,
) -> float:
    """Return a lower bound of the clearance of the centre lines along the whole motion [m].

    It bounds displacements only, and so may be below `certified_clearance`, which also bounds
    accelerations: by the gap [m] or, if that is more, by this part of it at most.
    """
    if not spheres:
        return np.inf
    cubics = cubics_between(robot, q, v, np.diff(times))
    return compiled.certified_clearance(
        compiled.CubicMotion(chain_of(robot), q, cubics, times),
        way_bounds(slides(robot), arm_points(robot, q[:1])[0], q[0], cubics),
        spheres_of(spheres, float(times[-1])),
        gap,
        part,
    )


def search_pair_distance(
    robot: Robot, motion: FollowedMotion, chosen: Indices, last: int, part: float
) -> float:
    """Return a bound within the same gap as that of `least_pair_distance` [m]."""
    if not len(chosen) or last < 0:
        return np.inf
    return compiled.certified_pair_distance(
        _cubic_motion(robot, motion),
        bodies_of(robot),
        pair_ways(robot, motion),
        chosen,
        last,
        CERTIFICATE_GAP,
        part,
    )


def search_distance(
    robot: Robot,
    motion: FollowedMotion,
    others: Sequence[Obstacle],
    chosen: Indices,
    last: int,
    part: float,
    gap: float = CERTIFICATE_GAP,
) -> float:
    """Return likewise that of `least_sphere_distance` or of `least_obstacle_distance` [m]."""
    if not len(chosen) or last < 0:
        return np.inf
    until, are_spheres = float(motion.time[-1]), others[0].is_sphere
    return compiled.certified_distance(
        _cubic_motion(robot, motion),
        bodies_of(robot),
        body_ways(robot, motion),
        spheres_of(others, until) if are_spheres else obstacles_of(others, until),
        chosen,
        last,
        gap,
        part,
    )


def _cubic_motion(robot: Robot, motion: FollowedMotion) -> compiled.CubicMotion:
    return compiled.CubicMotion(chain_of(robot), motion.q, cubics_of(robot, motion), motion.time)
