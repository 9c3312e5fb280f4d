"""The chaser moves only as its base allows: in the table's plane, or held in attitude by wheels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.requirements.requirement import (
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

# Motion that rounding alone makes where the base allows none [m, rad, m/s, rad/s].
_ROUNDING = 1e-6


class Plane(Requirement):
    """A chaser on a table moves in x, y and about z only; one held by wheels does not rotate."""

    name = "plane"

    def assess(self, samples: Samples) -> Assessment:
        """Return a failure for each motion of the chaser that its base does not allow."""
        base = samples.problem.robot.base
        if base is Base.FREE_FLYER:
            return Assessment()
        is_planar = base is Base.PLANAR
        words = "leaves the plane of its base: it" if is_planar else "is held by wheels, but"
        failures = [
            Failure(
                Status.CHECK_FAILED,
                f"the chaser {words} {what} up to {np.abs(off).max():.3g} {unit}",
                ("a report to the maintainers, for this is a fault of the planner",),
            )
            for what, off, unit in (_off_plane if is_planar else _turned)(samples)
            if not np.abs(off).max() <= _ROUNDING
        ]
        return Assessment(failures=failures)


def _off_plane(samples: Samples) -> Iterator[tuple[str, Array, str]]:
    """Yield the motions out of the plane, in words, with their sizes and units."""
    problem, motion = samples.problem, samples.trajectory
    height = problem.start.position_chaser_in_inertial[2]
    normals = rotation_from_quaternion(motion.chaser_quaternions_xyzw)[:, :, 2]
    yield "rises or sinks by", motion.chaser_positions[:, 2] - height, "m"
    yield "moves along z at", motion.chaser_linear_velocities[:, 2], "m/s"
    yield "tilts by", np.linalg.norm(normals[:, :2], axis=1), "rad"
    yield "turns about x and y at", motion.chaser_angular_velocities[:, :2], "rad/s"


def _turned(samples: Samples) -> Iterator[tuple[str, Array, str]]:
    """Yield the rotations since the start, in words, with their sizes and units."""
    problem, motion = samples.problem, samples.trajectory
    begins = rotation_from_quaternion(problem.start.quaternion_chaser_to_inertial_xyzw)
    axes = rotation_from_quaternion(motion.chaser_quaternions_xyzw)
    yield "turns by", np.linalg.norm(axes - begins, axis=(1, 2)) / np.sqrt(2.0), "rad"
    yield "turns at", motion.chaser_angular_velocities, "rad/s"
