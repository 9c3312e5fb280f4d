"""Plans of a bag that holds no exchanges: the trajectories that were published in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.tracking import measured_motion
from ff_planner_ros.bag.exchanges import urdfs_in
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.messages.trajectories import trajectory_in
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.state import SystemState

_TRAJECTORY, _PATH = "trajectory_msgs/msg/JointTrajectory", "nav_msgs/msg/Path"
_PREDICTED = "/predicted_chaser_path"


class PublishedMotion(NamedTuple):
    """A trajectory that was published, with the predicted path of the chaser."""

    topic: str
    frame: str  # the inertial frame
    start_ns: int  # time of the first point [ns]
    robot: Robot
    motion: Trajectory  # twists are differences of the path, torques are NaN


def published_motions(bag: Bag) -> Iterator[PublishedMotion]:
    """Yield the published trajectories whose robot and whose path of the chaser the bag holds.

    Raises:
        BagError: The disk fails.
    """
    robots = list(_robots(urdfs_in(bag)))
    paths = {
        nanoseconds(path.header.stamp): path
        for message, path in bag.decoded(_PATH)
        if message.topic.endswith(_PREDICTED)
    }
    for message, published in bag.decoded(_TRAJECTORY):
        start_ns = nanoseconds(published.header.stamp)
        names, path = tuple(published.joint_names), paths.get(start_ns)
        robot = next((one for one in robots if one.joint_names == names), None)
        if robot is None or path is None or len(published.points) < 2:
            continue
        try:
            motion = _motion(robot, published, path)
        except (InvalidInput, ValueError) as error:
            bag.note(f"a trajectory on {message.topic} cannot be understood: {error}")
        else:
            yield PublishedMotion(message.topic, path.header.frame_id, start_ns, robot, motion)


def _robots(urdfs: Iterable[str]) -> Iterator[Robot]:
    for urdf in urdfs:
        try:
            yield robot_from_urdf_text(urdf)
        except InvalidInput:
            continue


def _motion(robot: Robot, published: Any, path: Any) -> Trajectory:
    nothing = SimpleNamespace(poses=())
    plan = SimpleNamespace(
        joint_trajectory=published,
        chaser_path=path,
        chaser_twists=(),
        end_effector_path=nothing,
        end_effector_twists=(),
    )
    told = trajectory_in(plan)
    rates = _rates(told.time, told.chaser_quaternions_xyzw)
    velocities = np.gradient(told.chaser_positions, told.time, axis=0)
    rows = zip(
        told.chaser_positions,
        told.chaser_quaternions_xyzw,
        velocities,
        rates,
        told.joint_positions,
        told.joint_velocities,
        strict=True,
    )
    return measured_motion(robot, told.time, [SystemState(*row) for row in rows])


def _rates(time: Array, quaternions_xyzw: Array) -> Array:
    """Return the angular velocity at each point, in the inertial frame; shape (times, 3)."""
    attitudes = Rotation.from_quat(quaternions_xyzw)
    turns: Array = (attitudes[1:] * attitudes[:-1].inv()).as_rotvec() / np.diff(time)[:, None]
    return np.vstack((turns[:1], (turns[1:] + turns[:-1]) / 2.0, turns[-1:]))
