"""Certified distances for the search, by the compiled core; the check never uses them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, obstacles_of
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.robot.model import Robot

# Certificates are below the truth by at most this [m]: thinner than paint, and a quarter of the
# default margin.
CERTIFICATE_GAP = 5e-4


def search_pair_distance(
    robot: Robot, motion: FollowedMotion, chosen: Indices, last: int, part: float
) -> float:
    """Return a lower bound of the least distance of chosen pairs along a motion [m].

    It bounds displacements only, and so may be below `least_pair_distance`, which also bounds
    accelerations: by `CERTIFICATE_GAP` or, if that is more, by a part of it at most.

    Args:
        chosen: Numbers of pairs.
        last: Index of the last time that counts.
    """
    if not len(chosen) or last < 0:
        return np.inf
    asked = _motion(robot, motion), bodies_of(robot), chosen, last
    return compiled.certified_pairs(*asked, CERTIFICATE_GAP, part)


def search_distance(
    robot: Robot,
    motion: FollowedMotion,
    obstacles: Sequence[Obstacle],
    chosen: Indices,
    last: int,
    part: float,
    gap: float = CERTIFICATE_GAP,
) -> float:
    """Return likewise one of chosen bodies from obstacles [m].

    Args:
        chosen: Body times the number of obstacles, plus obstacle.
        gap: Absolute accuracy [m].
    """
    if not len(chosen) or last < 0:
        return np.inf
    among = obstacles_of(obstacles, float(motion.time[-1]))
    asked = _motion(robot, motion), bodies_of(robot), among, chosen, last
    return compiled.certified_obstacles(*asked, gap, part)


def _motion(robot: Robot, motion: FollowedMotion) -> compiled.CubicMotion:
    return compiled.CubicMotion(chain_of(robot), motion.q, motion.v, motion.time)
