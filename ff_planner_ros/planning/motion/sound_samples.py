"""The test whether samples from a file or a bag can be a motion of a robot."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ff_planner_ros.common.arrays import unit_quaternion
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.model import Robot

# Of any sample [SI]. Earth's orbit is smaller; squares of it are still numbers.
_LARGEST = 1e15


def require_sound_samples(robot: Robot, trajectory: Trajectory) -> None:
    """Refuse samples that cannot be a motion of this robot.

    Raises:
        InvalidInput: An array has the wrong shape, is not finite, larger than 1e15 or no rotation,
            or time does not increase.
    """
    points = len(trajectory.time) if trajectory.time.ndim == 1 else 0
    if points < 2:
        raise InvalidInput(
            Status.WRONG_SIZE, "time", trajectory.time, "it must be two numbers or more"
        )
    for item in fields(trajectory):
        values = getattr(trajectory, item.name)
        columns = _columns(item.name, robot.joints)
        if values.shape != (points, *columns):
            raise InvalidInput(
                Status.WRONG_SIZE,
                item.name,
                f"of shape {values.shape}",
                f"it must be of shape {(points, *columns)}",
            )
        if not np.isfinite(values).all():
            raise InvalidInput(Status.NOT_FINITE, item.name, "not finite", "every entry must be")
        largest = np.abs(values).max(initial=0.0)
        if largest > _LARGEST:
            allowed = f"no entry of a motion is larger than {_LARGEST:g}"
            raise InvalidInput(Status.OUT_OF_RANGE, item.name, largest, allowed)
        if item.name.endswith("quaternions_xyzw"):
            for quaternion in values:
                unit_quaternion(item.name, quaternion)
    if not (np.diff(trajectory.time) > 0.0).all():
        raise InvalidInput(
            Status.OUT_OF_RANGE, "time", "not increasing", "each point must be later than the last"
        )


def _columns(name: str, joints: int) -> tuple[int, ...]:
    if name == "time":
        return ()
    if name.startswith("joint_"):
        return (joints,)
    return (4,) if name.endswith("quaternions_xyzw") else (3,)
