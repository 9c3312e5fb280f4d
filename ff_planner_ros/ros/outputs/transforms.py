"""Transforms of the measured, the predicted and the previewed robot, and of its static frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.lifecycle import LifecycleNode
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.foreign import TFMessage
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.prediction import (
    GRASP_FRAME,
    FramePose,
    predicted_pose,
    predicted_target,
)
from ff_planner_ros.ros.qos import create_lifecycle_publisher
from ff_planner_ros.ros.topics import TF, TF_STATIC

# Suffix of the frame at the chaser's centre of mass, which is no link of the URDF.
CENTER_OF_MASS = "_center_of_mass"
_TARGET = "target"


class Transforms:
    """Publishes `/tf` and `/tf_static` while the node is active."""

    def __init__(self, node: LifecycleNode, robot: Robot, parameters: NodeParameters) -> None:
        """Create the publishers, which are silent until the node is active."""
        self._robot, self._frame = robot, parameters.inertial_frame
        self._links, self._settings = tuple(carried_links(robot)), parameters.tf
        self._root, self._data = root_link(robot), robot.model.createData()
        self._told_ns: dict[str, int] = {}  # newest stamp of each frame
        self._parameters, self._static = parameters, self._fixed_to_chaser(parameters)
        self._moving = create_lifecycle_publisher(node, TF)
        self._fixed = create_lifecycle_publisher(node, TF_STATIC)
        self.publishers = self._moving, self._fixed

    def describe(self) -> None:
        """Publish the static transforms; to be called when the node becomes active."""
        self._fixed.publish(TFMessage(transforms=list(self._static.values())))

    def use(self, robot: Robot) -> None:
        """Publish those of a robot whose joints and links are the same, elsewhere, from now on."""
        self._robot, self._data = robot, robot.model.createData()
        self._static |= self._fixed_to_chaser(self._parameters)
        self.describe()

    def measured(self, state: SystemState, stamp_ns: int) -> None:
        """Publish the root link's pose from a state measured at stamp_ns [ns]."""
        attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
        chaser = FramePose(state.position_chaser_in_inertial, attitude)
        self._publish(stamp_ns, [(self._frame, self._root, root_pose(self._robot, chaser))])

    def predicted(
        self, motion: Trajectory, start_ns: int, time_ns: int, captured: CapturedBody | None
    ) -> None:
        """Publish the predicted poses of root link, end effector and target at time_ns [ns]."""
        prefix, time = self._settings.predicted_prefix, (time_ns - start_ns) / NANOSECONDS
        chaser, ee = (predicted_pose(motion, frame, time) for frame in ("chaser", "ee"))
        if not prefix or chaser is None or ee is None:
            return
        frames = [
            (self._frame, f"{prefix}{self._root}", root_pose(self._robot, chaser)),
            (self._frame, f"{prefix}{self._robot.tip_link}", ee),
        ]
        if captured is not None:
            there = predicted_target(motion, time, captured)
            frames.append((self._frame, f"{prefix}{_TARGET}", there))
        self._publish(time_ns, frames)

    def preview(
        self,
        motion: Trajectory,
        time: float,
        positions: Sequence[float],
        time_ns: int,
        captured: CapturedBody | None,
    ) -> None:
        """Publish the poses of links and target at one time of a plan's preview.

        Args:
            time: Time from the plan's start [s].
            positions: Joint positions at that time. Shape (joints,).
            time_ns: Stamp of the transforms [ns].
        """
        prefix, chaser = self._settings.preview_prefix, predicted_pose(motion, "chaser", time)
        if not prefix or chaser is None:
            return
        root = root_pose(self._robot, chaser)
        q = np.concatenate([root.position, root.rotation.as_quat(), positions])
        pin.framesForwardKinematics(self._robot.model, self._data, q)
        frames = [(self._frame, f"{prefix}{self._root}", root), *self._on_links(prefix)]
        if captured is not None:
            there = predicted_target(motion, time, captured)
            frames.append((self._frame, f"{prefix}{_TARGET}", there))
        self._publish(time_ns, frames)

    def _on_links(self, prefix: str) -> Iterator[tuple[str, str, FramePose]]:
        """Yield parent link, link and pose, link by link as the URDF has them."""
        frames, data = self._robot.model.frames, self._data
        for link, carrier in self._links:
            found = data.oMf[carrier].actInv(data.oMf[link])
            pose = FramePose(found.translation, Rotation.from_matrix(found.rotation))
            parent, child = (f"{prefix}{frames[each].name}" for each in (carrier, link))
            yield parent, child, pose

    def published(self, captured: CapturedBody | None) -> None:
        """Publish the grasp's pose in the target body that a published plan captures, if any."""
        prefix = self._settings.predicted_prefix
        if captured is None or not prefix:
            return
        grasp = captured.place.inverse()
        pose = FramePose(grasp.translation, Rotation.from_matrix(grasp.rotation))
        self._static[GRASP_FRAME] = _transform(f"{prefix}{_TARGET}", GRASP_FRAME, pose, 0)
        self.describe()

    def _fixed_to_chaser(self, parameters: NodeParameters) -> dict[str, TransformStamped]:
        """Return static transforms from the root link to frames that are no links, by name."""
        to_root = self._robot.rotation_chaser_to_base
        center = FramePose(self._robot.position_chaser_in_base, Rotation.from_matrix(to_root))
        fixed = {f"{self._robot.base_link}{CENTER_OF_MASS}": center}
        sensor = parameters.odometry
        if parameters.state_source == "odometry" and not self._robot.model.existFrame(
            sensor.child_frame_id
        ):
            turn = Rotation.from_quat(sensor.sensor_quaternion_in_chaser_xyzw)
            position = center.position + to_root @ sensor.sensor_position_in_chaser
            fixed[sensor.child_frame_id] = FramePose(position, center.rotation * turn)
        return {name: _transform(self._root, name, pose, 0) for name, pose in fixed.items()}

    def _publish(self, stamp_ns: int, frames: Iterable[tuple[str, str, FramePose]]) -> None:
        """Publish frames, each in its parent; whoever buffers transforms minds repeated ones."""
        new = [one for one in frames if self._told_ns.get(one[1], -1) != stamp_ns]
        self._told_ns |= dict.fromkeys((child for _, child, _ in new), stamp_ns)
        if new:
            told = [_transform(*one, stamp_ns) for one in new]
            self._moving.publish(TFMessage(transforms=told))


def root_link(robot: Robot) -> str:
    """Return the link that carries all others: the only one that a measured transform may move."""
    frames = (frame for frame in robot.model.frames if frame.type == pin.FrameType.BODY)
    return next(str(frame.name) for frame in frames if frame.parentJoint == 1)


def carried_links(robot: Robot) -> Iterator[tuple[int, int]]:
    """Yield each link but the root and its parent link, as indices of the model's frames."""
    frames, root = robot.model.frames, root_link(robot)
    for link, frame in enumerate(frames):
        if frame.type == pin.FrameType.BODY and frame.name != root:
            carrier = frame.parentFrame
            while frames[carrier].type != pin.FrameType.BODY:  # joints, which are frames, too
                carrier = frames[carrier].parentFrame
            yield link, carrier


def root_pose(robot: Robot, chaser: FramePose) -> FramePose:
    """Return the root link's pose from the pose of the chaser frame, at its centre of mass."""
    rotation = chaser.rotation * Rotation.from_matrix(robot.rotation_chaser_to_base).inv()
    return FramePose(
        chaser.position - rotation.as_matrix() @ robot.position_chaser_in_base,
        rotation,
    )


def _transform(parent: str, child: str, pose: FramePose, stamp_ns: int) -> TransformStamped:
    x, y, z = map(float, pose.position)
    turn_x, turn_y, turn_z, turn_w = map(float, pose.rotation.as_quat())
    return TransformStamped(
        header=Header(stamp=time_message(stamp_ns), frame_id=parent),
        child_frame_id=child,
        transform=Transform(
            translation=Vector3(x=x, y=y, z=z),
            rotation=Quaternion(x=turn_x, y=turn_y, z=turn_z, w=turn_w),
        ),
    )
