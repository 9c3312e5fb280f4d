"""The joints' torques stay within the effort limits of the URDF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import LIMIT_TOLERANCE, Requirement, Samples
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import joint_torques


class Torques(Requirement):
    """The torques at the points stay within the effort limits."""

    name = "torques"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start whose accelerations take too much torque."""
        robot, accelerations = problem.robot, problem.start.joint_accelerations
        if accelerations is None:
            return
        _, v_start = configuration(robot, problem.start)
        (torques,) = joint_torques(robot, q_start[None], v_start[None], accelerations[None])
        excess = np.abs(torques) - robot.effort_limits
        joint = int(excess.argmax())
        if excess[joint] > LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                f"joints.acceleration[{robot.joint_names[joint]}]",
                f"{accelerations[joint]:.6f} rad/s2, for which the joint needs "
                f"{torques[joint]:.4g} N m",
                f"its effort limit is {robot.effort_limits[joint]:g} N m either way",
            )

    def metrics(self, samples: Samples) -> Mapping[str, tuple[float, ...]]:
        """Return the largest torque of each joint."""
        return {"peak_joint_torques": tuple(np.abs(samples.torques).max(axis=0).tolist())}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield the joint whose torque exceeds its limit by most."""
        robot, limits = samples.problem.robot, samples.problem.robot.effort_limits
        if (np.array(metrics.peak_joint_torques) <= limits + LIMIT_TOLERANCE).all():
            return
        torques = samples.torques
        excess = np.abs(torques) - limits
        point, joint = np.unravel_index(excess.argmax(), excess.shape)
        yield Failure(
            Status.TORQUE_TOO_HIGH,
            f"joint {robot.joint_names[joint]} needs {torques[point, joint]:.4g} N m, "
            f"{excess[point, joint]:.4g} N m more than its effort limit of {limits[joint]:g} N m, "
            f"at {samples.when(point)}",
            ("a longer duration",),
        )
