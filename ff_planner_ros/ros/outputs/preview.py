"""The planned joint motion, to be played again and again for a robot model on a screen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import JointState

from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan


class Previewed(NamedTuple):
    """One moment of a preview."""

    time: float  # since the plan's first point [s]
    joints: JointState


def preview_joint_states(plan: Plan, rate: float) -> list[Previewed]:
    """Return one pass through a plan at a rate [Hz], first and last point included.

    The states have no stamp: the publisher sets it to now.
    """
    duration = float(plan.trajectory.time[-1])
    # The last step is the shorter one, where the duration is no multiple of the period.
    times = np.append(np.arange(0.0, duration, 1.0 / rate), duration)
    positions, velocities, _ = joint_motion(plan.trajectory).at(times)
    return [
        Previewed(
            time, JointState(name=list(plan.joint_names), position=position, velocity=velocity)
        )
        for time, position, velocity in zip(
            times.tolist(), positions.tolist(), velocities.tolist(), strict=True
        )
    ]
