"""Certificates while a search goes on: by the compiled core, and none above the check's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.chain import chain_of
from ff_planner_ros.planning.distance.body_certificate import (
    body_ways,
    cubics_of,
    least_pair_distance,
    least_sphere_distance,
    pair_ways,
)
from ff_planner_ros.planning.distance.certificate import CERTIFICATE_GAP, cubics_between, way_bounds
from ff_planner_ros.planning.distance.clearance import arm_points, attached_to_bodies, sphere_arrays
from ff_planner_ros.planning.distance.compiled_bodies import compiled_bodies
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Sphere
from ff_planner_ros.robot.model import Robot


def search_certificate(
    robot: Robot, q: Array, v: Array, times: Array, spheres: Sequence[Sphere]
) -> float:
    """Return a lower bound of the clearance along the whole motion; the check never asks here.

    By how far arm and spheres move alone, and thus below `certified_clearance`, which knows how
    they bend: by `CERTIFICATE_GAP` at most.
    """
    if not spheres:
        return np.inf
    cubics = cubics_between(robot, q, v, np.diff(times))
    return compiled.certified_clearance(
        chain_of(robot),
        q,
        cubics,
        way_bounds(arm_points(robot, q[:1])[0], q[0], cubics),
        times,
        *sphere_arrays(spheres),
        CERTIFICATE_GAP,
        attached_to_bodies(spheres, float(times[-1])),
    )


def search_pair_distance(
    robot: Robot, motion: FollowedMotion, chosen: Indices, last: int, part: float
) -> float:
    """Return what is certified by `least_pair_distance`, or as good a bound."""
    if not len(chosen) or last < 0:
        return np.inf
    found = compiled.certified_pair_distance(
        chain_of(robot),
        compiled_bodies(robot),
        motion.q,
        cubics_of(robot, motion),
        pair_ways(robot, motion),
        motion.time,
        chosen,
        last,
        CERTIFICATE_GAP,
        part,
    )
    if np.isfinite(found):
        return found
    return least_pair_distance(robot, motion, chosen, last, part).certified


def search_sphere_distance(
    robot: Robot,
    motion: FollowedMotion,
    spheres: Sequence[Sphere],
    chosen: Indices,
    last: int,
    part: float,
) -> float:
    """Return what is certified by `least_sphere_distance`, or as good a bound."""
    if not len(chosen) or last < 0:
        return np.inf
    found = compiled.certified_sphere_distance(
        chain_of(robot),
        compiled_bodies(robot),
        motion.q,
        cubics_of(robot, motion),
        body_ways(robot, motion),
        motion.time,
        *sphere_arrays(spheres),
        chosen,
        last,
        CERTIFICATE_GAP,
        part,
        attached_to_bodies(spheres, float(motion.time[-1])),
    )
    if np.isfinite(found):
        return found
    return least_sphere_distance(robot, motion, spheres, chosen, last, part).certified
