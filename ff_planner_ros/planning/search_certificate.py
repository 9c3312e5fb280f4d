"""The certificate while a search goes on: `certified_clearance` by the compiled core."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.chain import chain_of
from ff_planner_ros.planning.certificate import CERTIFICATE_GAP, cubics_between, way_bounds
from ff_planner_ros.planning.clearance import arm_points, attached_to_bodies, sphere_arrays
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.robot.model import Robot


def search_certificate(
    robot: Robot, q: Array, v: Array, times: Array, spheres: Sequence[Sphere]
) -> float:
    """Return what `certified_clearance` does, to rounding; the check never asks here."""
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
