"""The end effector is at the target when the duration is over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem import PlanningProblem, Target
from ff_planner_ros.planning.requirements.requirement import (
    Requirement,
    Rows,
    Samples,
    too_large,
)
from ff_planner_ros.robot.model import Robot

# The solver keeps each row of a family's goal error within this; a tenth of what the check allows.
_BAND = 1e-5
# A motion leaves its path where steps are long, or where a singularity lies between two.
_FOLLOW = "more points, or a nearer goal if it is at the edge of the workspace"


class Goal(Requirement):
    """The end effector is at the target, in position and orientation."""

    name = "goal"

    def rows(
        self, problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
    ) -> Rows:
        """Return what the family does not hold at the goal by itself, within a narrow band."""
        error, jacobian = motion.goal_error, sensitivity.goal_error
        values = np.append(_BAND - error, _BAND + error)
        return Rows(values, np.concatenate([-jacobian, jacobian]), np.arange(len(values)))

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return how far the end effector is from the target: where it comes, or should come."""
        robot, target, motion = samples.problem.robot, samples.problem.target, samples.followed
        reached = motion.q[motion.pieces * samples.goal]
        misses = [miss(robot, q, target) for q in (reached, samples.q[samples.goal])]
        position, turn = np.linalg.norm(misses, axis=2).max(axis=0).tolist()
        return {"final_position_error": position, "final_orientation_error": turn}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield each error that is too large."""
        for quantity, unit in (("position", " m"), ("orientation", " rad")):
            tolerance = getattr(samples.settings, f"{quantity}_tolerance")
            yield from too_large(metrics, f"final_{quantity}_error", tolerance, unit, _FOLLOW)


def miss(robot: Robot, q: Array, target: Target) -> Array:
    """Return the way [m] and the turn [rad] from the end effector to a target, inertial axes.

    Returns:
        Shape (2, 3).
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    to_inertial = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    return np.array([target.position - tip.translation, pin.log3(to_inertial @ tip.rotation.T)])


def beside(target: Target, way: Array, turn: Array) -> Target:
    """Return a target moved by a way [m] and a turn [rad], inertial axes."""
    turned = pin.Quaternion(pin.exp3(turn)) * pin.Quaternion(target.quaternion_xyzw)
    return replace(
        target, position=target.position + way, quaternion_xyzw=turned.normalized().coeffs()
    )
