"""The joints' torques stay within the effort limits of the URDF, between the points too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.requirements.requirement import LIMIT_TOLERANCE, Requirement, Samples
from ff_planner_ros.robot.dynamics import joint_torques


class Torques(Requirement):
    """The torques stay within the effort limits."""

    name = "torques"

    def metrics(self, samples: Samples) -> Mapping[str, tuple[float, ...]]:
        """Return the largest torque of each joint."""
        torques, _ = _peaks(samples)
        return {"peak_joint_torques": tuple(np.abs(torques).tolist())}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield the joint whose torque exceeds its limit by most."""
        robot, limits = samples.problem.robot, samples.problem.robot.effort_limits
        if (np.array(metrics.peak_joint_torques) <= limits + LIMIT_TOLERANCE).all():
            return
        torques, times = _peaks(samples)
        excess = np.abs(torques) - limits
        joint = excess.argmax()
        yield Failure(
            Status.TORQUE_TOO_HIGH,
            f"joint {robot.joint_names[joint]} needs {torques[joint]:.4g} N m, "
            f"{excess[joint]:.4g} N m more than its effort limit of {limits[joint]:g} N m, "
            f"at {samples.at(times[joint])}",
            ("a longer duration",),
        )


def _peaks(samples: Samples) -> tuple[Array, Array]:
    """Return each joint's largest torque, its sign kept, and when. Each of shape (joints,).

    The torques at the steps of the motion are looked at, and around the largest of them the
    parabola through it and its neighbours.
    """
    motion, robot = samples.followed, samples.problem.robot
    _, _, accelerations = motion.joints.at(motion.time)
    torques = joint_torques(robot, motion.q, motion.v, accelerations)
    middle = np.clip(np.abs(torques).argmax(axis=0), 1, len(torques) - 2)
    before, there, after = (torques[middle + k, range(robot.joints)] for k in (-1, 0, 1))
    slope, curvature = (after - before) / 2, before + after - 2 * there
    with np.errstate(divide="ignore", invalid="ignore"):
        aside = np.clip(np.nan_to_num(-slope / curvature), -1.0, 1.0)
    peaks = there + slope * aside + curvature * aside**2 / 2
    return peaks, np.interp(middle + aside, np.arange(len(motion.time)), motion.time)
