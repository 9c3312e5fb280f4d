"""On an air-bearing table the chaser stays on the table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.requirements.requirement import Requirement, Samples
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

# What rounding lifts or tilts a chaser that stays on its table [m], [rad], [m/s], [rad/s].
_ROUNDING = 1e-6


class Plane(Requirement):
    """A chaser on a planar base moves in x, y and about z only."""

    name = "plane"

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield how far the chaser leaves the plane."""
        problem, motion = samples.problem, samples.trajectory
        if problem.robot.base is Base.FREE_FLYER:
            return
        normals = rotation_from_quaternion(motion.chaser_quaternions_xyzw)[:, :, 2]
        for what, off, unit in (
            (
                "rises or sinks by",
                motion.chaser_positions[:, 2] - problem.start.position_chaser_in_inertial[2],
                "m",
            ),
            ("moves along z at", motion.chaser_linear_velocities[:, 2], "m/s"),
            ("tilts by", np.linalg.norm(normals[:, :2], axis=1), "rad"),
            ("turns about x and y at", motion.chaser_angular_velocities[:, :2], "rad/s"),
        ):
            most = float(np.abs(off).max())
            if not most <= _ROUNDING:
                yield Failure(
                    Status.CHECK_FAILED,
                    f"the chaser leaves the plane of its base: it {what} up to {most:.3g} {unit}",
                    ("a report to the maintainers, for this is a fault of the planner",),
                )
