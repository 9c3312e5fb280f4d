"""No external force acts: momentum is constant, and torques match inverse dynamics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    Requirement,
    Samples,
    too_large,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import momenta_about_origin, total_momenta, total_momentum

_REPORT = "a report to the maintainers, for this is a fault of the planner"


class Momentum(Requirement):
    """Momentum and torques are those of a system without external forces."""

    name = "momentum"

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return the largest errors of momentum, relative, and of torques [N m, N]."""
        problem, trajectory, robot = samples.problem, samples.trajectory, samples.problem.robot
        data = robot.model.createData()
        momentum = total_momenta(robot, *samples.q_and_v, samples.maps)
        wanted = total_momentum(robot, data, *configuration(robot, problem.start))
        # A system whose total is zero is measured against the chaser's own momentum; where that is
        # zero too, against what carries the system off by the goal's tolerance.
        mass, way = pin.computeTotalMass(robot.model, data), samples.settings.position_tolerance
        scale = max(
            float(np.linalg.norm(wanted)),
            _chaser_momentum(robot, *samples.q_and_v),
            mass * way / problem.duration,
        )
        off = np.linalg.norm((momentum - wanted)[:, robot.base.rows], axis=1).max()
        return {
            "momentum_error": float(off / scale),
            "torque_error": float(np.abs(trajectory.joint_torques - samples.torques).max()),
        }

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield each error that is too large."""
        tolerance = samples.settings.momentum_tolerance
        yield from too_large(metrics, "momentum_error", tolerance, "", _REPORT)
        off = np.abs(samples.trajectory.joint_torques - samples.torques).max(axis=0)
        unit = samples.problem.robot.effort_unit(int(off.argmax()))
        yield from too_large(metrics, "torque_error", LIMIT_TOLERANCE, f" {unit}", _REPORT)


def _chaser_momentum(robot: Robot, q: Array, v: Array) -> float:
    """Return the largest size of the chaser's own momentum, linear and angular about the origin."""
    own = momenta_about_origin(q, v[:, :6] @ robot.model.inertias[1].matrix())
    return float(np.linalg.norm(own, axis=1).max())
