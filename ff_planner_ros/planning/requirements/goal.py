"""The end effector is at the target when the duration is over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin

from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import (
    Requirement,
    Rows,
    Samples,
    too_large,
)

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
        return np.append(_BAND - error, _BAND + error), np.concatenate([-jacobian, jacobian])

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return how far the end effector is from the target at the goal."""
        robot, target = samples.problem.robot, samples.problem.target
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, samples.q[samples.goal])
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
        target_rotation = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
        turn = pin.log3(tip.rotation.T @ target_rotation)
        return {
            "final_position_error": float(np.linalg.norm(tip.translation - target.position)),
            "final_orientation_error": float(np.linalg.norm(turn)),
        }

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield each error that is too large."""
        for quantity, unit in (("position", " m"), ("orientation", " rad")):
            tolerance = getattr(samples.settings, f"{quantity}_tolerance")
            yield from too_large(metrics, f"final_{quantity}_error", tolerance, unit, _FOLLOW)
