"""Nothing pushes the system: its momentum is constant, and its torques are those of its motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    Requirement,
    Samples,
    too_large,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum

_REPORT = "a report to the maintainers, for this is a fault of the planner"


class Momentum(Requirement):
    """Total momentum and torques are those of a system that nothing pushes."""

    name = "momentum"

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return the errors of momentum and torques."""
        problem, trajectory, robot = samples.problem, samples.trajectory, samples.problem.robot
        data = robot.model.createData()
        momentum = np.array(
            [total_momentum(robot, data, *at) for at in zip(*samples.q_and_v, strict=True)]
        )
        wanted = total_momentum(robot, data, *configuration(robot, problem.start))
        chaser_momentum = robot.model.inertias[1].mass * trajectory.chaser_linear_velocities
        # A system whose total is zero is measured against the chaser's own momentum.
        scale = max(np.linalg.norm(wanted), np.linalg.norm(chaser_momentum, axis=1).max())
        off = np.linalg.norm(momentum - wanted, axis=1).max()
        return {
            "momentum_error": float(off / scale),
            "torque_error": float(np.abs(trajectory.joint_torques - samples.torques).max()),
        }

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield each error that is too large."""
        tolerance = samples.settings.momentum_tolerance
        yield from too_large(metrics, "momentum_error", tolerance, "", _REPORT)
        yield from too_large(metrics, "torque_error", LIMIT_TOLERANCE, " N m", _REPORT)
