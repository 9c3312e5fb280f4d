"""No external force acts: momentum is constant, and torques match inverse dynamics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    Assessment,
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

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest errors of momentum, relative, and of torques [N m, N]."""
        problem, settings, robot = samples.problem, samples.settings, samples.problem.robot
        data = robot.model.createData()
        momentum = total_momenta(robot, *samples.q_and_v, samples.maps)
        wanted = total_momentum(robot, data, *configuration(robot, problem.start))
        # A system whose total is zero is measured against the chaser's own momentum; where that is
        # zero too, against what carries the system off by the goal's tolerance.
        mass, way = pin.computeTotalMass(robot.model, data), settings.position_tolerance
        scale = max(
            float(np.linalg.norm(wanted)),
            _chaser_momentum(robot, *samples.q_and_v),
            mass * way / problem.duration,
        )
        off = np.linalg.norm((momentum - wanted)[:, robot.base.rows], axis=1).max()
        torques = np.abs(samples.trajectory.joint_torques - samples.torques).max(axis=0)
        unit = robot.effort_unit(int(torques.argmax()))
        found = {"momentum_error": float(off / scale), "torque_error": float(torques.max())}
        allowed = {
            "momentum_error": (settings.momentum_tolerance, ""),
            "torque_error": (LIMIT_TOLERANCE, f" {unit}"),
        }
        failures = [
            failure
            for name, value in found.items()
            for failure in too_large(name, value, *allowed[name], _REPORT)
        ]
        return Assessment(found, failures)


def _chaser_momentum(robot: Robot, q: Array, v: Array) -> float:
    """Return the largest size of the chaser's own momentum, linear and angular about the origin."""
    own = momenta_about_origin(q, v[:, :6] @ robot.model.inertias[1].matrix())
    return float(np.linalg.norm(own, axis=1).max())
