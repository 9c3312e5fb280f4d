"""The plan begins with the joint velocities of the start.

The planner's own plans do so by construction. Other methods leave out the null-space motion of the
start: their joint velocities jump by as much.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    Requirement,
    Samples,
    too_large,
)


class StartVelocity(Requirement):
    """Joint velocities do not jump at the start."""

    name = "start_velocity"

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return the largest velocity jump [rad/s], of prismatic joints by their weight."""
        jump = samples.trajectory.joint_velocities[0] - samples.problem.start.joint_velocities
        shares = samples.problem.robot.joint_weights * jump
        return {"start_velocity_jump": float(np.abs(shares).max())}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield a jump that is too large."""
        yield from too_large(
            metrics,
            "start_velocity_jump",
            samples.settings.start_velocity_tolerance + LIMIT_TOLERANCE,
            " rad/s",
            "--method optimal, which takes the start's null-space motion along",
        )
