"""The plan begins with the joint velocities of the start.

The planner's own plans do so by construction. Other methods leave out the null-space motion of the
start: their joint velocities jump by as much.
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    Assessment,
    Requirement,
    Samples,
    too_large,
)


class StartVelocity(Requirement):
    """Joint velocities do not jump at the start."""

    name = "start_velocity"

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest velocity jump [rad/s], of prismatic joints by their weight."""
        jump = samples.trajectory.joint_velocities[0] - samples.problem.start.joint_velocities
        largest = float(np.abs(samples.problem.robot.joint_weights * jump).max())
        failures = too_large(
            "start_velocity_jump",
            largest,
            samples.settings.start_velocity_tolerance + LIMIT_TOLERANCE,
            " rad/s",
            "--method optimal, which takes the start's null-space motion along",
        )
        return Assessment({"start_velocity_jump": largest}, tuple(failures))
