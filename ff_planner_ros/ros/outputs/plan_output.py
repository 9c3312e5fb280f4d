"""Everything that the node publishes of a plan: for controllers, for screens, while it runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PublishedPlan as PublishedPlanMessage
from ff_planner_msgs.msg import TrackingError, WheelState
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan, Trajectory, WheelMotion
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs import prediction
from ff_planner_ros.ros.outputs.execution import Execution
from ff_planner_ros.ros.outputs.markers import plan_markers
from ff_planner_ros.ros.outputs.preview import Previewed, preview_joint_states
from ff_planner_ros.ros.outputs.transforms import Transforms
from ff_planner_ros.ros.qos import LATCHED_QOS, STREAM_QOS, qos_profile


@dataclass(frozen=True, eq=False)
class PublishedPlan:
    """The last plan that went out."""

    plan_id: str
    trajectory: Trajectory
    start_ns: int
    target_body: TargetBody | None = None  # that it captures, at its first point; None: none
    duration: float | None = None  # from the first point to the goal [s]; None: to the last point
    before: PublishedPlan | None = None  # what runs until it begins, alone; None: not known
    wheels: WheelMotion | None = None  # that hold the chaser; None: there are none

    @property
    def seconds_to_goal(self) -> float:
        """From its first point to the goal [s]."""
        return float(self.trajectory.time[-1]) if self.duration is None else self.duration

    def at(self, time_ns: int) -> PublishedPlan | None:
        """Return the plan, this one or what it takes over from, that runs at a time [ns]."""
        if time_ns < self.start_ns:
            return None if self.before is None else self.before.at(time_ns)
        end_ns = self.start_ns + round(float(self.trajectory.time[-1]) * NANOSECONDS)
        return self if time_ns <= end_ns else None

    def motion(self, since_ns: int) -> JointMotion:
        """Return what the joints do, with the time counted from a moment [ns]."""
        # The controller was told whole nanoseconds, and so was the bag, which a replay starts from.
        told = np.rint(self.trajectory.time * NANOSECONDS) / NANOSECONDS
        start = (self.start_ns - since_ns) / NANOSECONDS
        return joint_motion(replace(self.trajectory, time=told), start)


class PlanOutput:
    """Publishes while the node is active, and remembers the last plan."""

    def __init__(self, node: LifecycleNode, robot: Robot, parameters: NodeParameters) -> None:
        """Create the publishers, which are silent until the node is active."""
        self._base_link, self._frame = robot.base_link, parameters.inertial_frame
        self.transforms = Transforms(node, robot, parameters)
        self.execution = Execution(node, parameters.controller, self._forget_plan)
        self._rates, qos = parameters.rates, parameters.qos
        self._clock = node.get_clock()
        self.published: PublishedPlan | None = None  # the last plan that went out
        self.tracking: prediction.TrackingError | None = None  # None while no plan runs
        self.published_one: Callable[[], None] = lambda: None  # called after a plan has gone out
        self._preview: Iterator[Previewed] = iter(())
        self._previewed: tuple[Trajectory, TargetBody | None] | None = None
        self._repeated_since_ns: int | None = None  # None while it is played for the first time
        self._viewers = 1  # of the preview, when they were last counted
        self._node = node
        self._publishers: list[LifecyclePublisher] = [
            *self.transforms.publishers,
            *self.execution.publishers,
        ]
        self._trajectory, self._path, self._pose = (
            self._publisher(kind, name, qos_profile(getattr(qos, name)))
            for kind, name in (
                (JointTrajectory, "joint_trajectory"),
                (Path, "predicted_chaser_path"),
                (PoseStamped, "predicted_chaser_pose"),
            )
        )
        # What is told of a target body is told as the same of the chaser is.
        self._target_path = self._publisher(
            Path, "predicted_target_path", qos_profile(qos.predicted_chaser_path)
        )
        self._relative_pose = self._publisher(
            PoseStamped, "predicted_relative_pose", qos_profile(qos.predicted_chaser_pose)
        )
        self._wheels = self._publisher(
            WheelState, "predicted_wheel_momentum", qos_profile(qos.predicted_chaser_pose)
        )
        # Who hears the trajectory can also hear whose it is.
        self._published_plan = self._publisher(
            PublishedPlanMessage, "published_plan", qos_profile(qos.joint_trajectory)
        )
        self._tracking_error = self._publisher(TrackingError, "tracking_error", STREAM_QOS)
        self._markers = self._publisher(MarkerArray, "markers", LATCHED_QOS)
        self._joint_states = self._publisher(JointState, "planned_joint_states", STREAM_QOS)
        self._description = self._publisher(String, "robot_description", LATCHED_QOS)
        group = MutuallyExclusiveCallbackGroup()
        self._timer = node.create_timer(1.0 / self._rates.preview, self._play_preview, group)
        self._timer.cancel()  # until there is something to play

    def describe_robot(self, urdf: str) -> None:
        """Publish the text of the robot's URDF file; to be called when the node becomes active."""
        self._description.publish(String(data=urdf))
        self.transforms.describe()

    def publish(
        self,
        plan_id: str,
        plan: Plan,
        written: PlanMessage,
        for_controller: JointTrajectory,
        requester: str,
        end_behaviour: str,
        body: TargetBody | None = None,
        previous_plan_id: str = "",
    ) -> None:
        """Publish what controllers and executives wait for.

        Args:
            previous_plan_id: Of the plan that the joints follow until it begins; empty: of none.
        """
        self._trajectory.publish(for_controller)
        self._published_plan.publish(
            PublishedPlanMessage(
                header=Header(stamp=self._clock.now().to_msg(), frame_id=self._frame),
                plan_id=plan_id,
                requester=requester,
                start_time=for_controller.header.stamp,
                joint_trajectory=for_controller,
                end_behaviour=end_behaviour,
            )
        )
        self._path.publish(written.chaser_path)
        if body is not None:
            self._target_path.publish(written.target_path)
        start_ns = nanoseconds(for_controller.header.stamp)
        last = self.published
        before = None
        if last is not None and last.plan_id == previous_plan_id:
            before = replace(last, before=None)
        self.published = PublishedPlan(
            plan_id, plan.trajectory, start_ns, body, plan.duration, before, plan.wheels
        )
        goal_ns = start_ns + round(self.published.seconds_to_goal * NANOSECONDS)
        self.execution.published(plan_id, start_ns, goal_ns, for_controller)
        self.transforms.published(body)
        self.published_one()

    @property
    def is_streamed(self) -> bool:
        """Whether a plan runs, or will, or the chaser is told of as measured.

        No tracking is told of a plan that is over.
        """
        published, now_ns = self.published, self._clock.now().nanoseconds
        runs = published is not None and (
            now_ns <= published.start_ns or published.at(now_ns) is not None
        )
        if not runs:
            self.tracking = None
        return runs or self.transforms.measures

    def show(self, robot: Robot, plan: Plan, scene: Scene) -> None:
        """Publish what is drawn of a plan."""
        self._markers.publish(plan_markers(robot, plan, scene, self._frame))
        self._previewed = plan.trajectory, scene.target_body
        self._preview = self._played(preview_joint_states(plan, self._rates.preview))
        self._timer.reset()

    def look_for_viewers(self, recorders: int) -> None:
        """Play the preview again where somebody subscribes, beside so many recorders."""
        self._viewers = self._joint_states.get_subscription_count() - recorders
        if self._viewers > 0 and self._timer.is_canceled() and self._repeated_since_ns is not None:
            self._timer.reset()

    def stream(self, measured: Snapshot | None) -> None:
        """Publish where the chaser should be by now, and how far from there it was measured."""
        running, self.tracking = self.published, None
        if measured is not None:
            self.transforms.measured(measured.state, measured.stamp_ns)
        if running is None:
            return
        motion, start_ns = running.trajectory, running.start_ns
        now_ns = self._clock.now().nanoseconds
        pose = prediction.predicted_chaser_pose(motion, start_ns, now_ns, self._frame)
        if pose is not None:
            self._pose.publish(pose)
        self.transforms.predicted(motion, start_ns, now_ns, running.target_body)
        if running.target_body is not None:
            relative = prediction.predicted_relative_pose(
                motion, start_ns, now_ns, running.target_body
            )
            if relative is not None:
                self._relative_pose.publish(relative)
        if running.wheels is not None:
            held = prediction.predicted_wheels(
                motion.time, running.wheels, start_ns, now_ns, self._base_link
            )
            if held is not None:
                self._wheels.publish(held)
        if measured is None:
            return
        error = prediction.tracking_error(motion, start_ns, measured.state, measured.stamp_ns)
        self.tracking = error
        if error is not None:
            stamp = time_message(measured.stamp_ns)
            self._tracking_error.publish(
                TrackingError(
                    header=Header(stamp=stamp, frame_id=self._frame),
                    plan_id=running.plan_id,
                    **error._asdict(),
                )
            )

    def forget(self, why: str) -> None:
        """Forget the last plan: its time is no longer the clock's."""
        self.published = self.tracking = None
        self.execution.forget(why)

    def close(self) -> None:
        """Remove timer and publishers from the node."""
        self._node.destroy_timer(self._timer)
        self.execution.close()
        for publisher in self._publishers:
            self._node.destroy_lifecycle_publisher(publisher)

    def _forget_plan(self, plan_id: str) -> None:
        """Take a plan that the controller does not bring to its end for none that runs."""
        if self.published is not None and self.published.plan_id == plan_id:
            self.published = self.tracking = None

    def _publisher(self, kind: type, topic: str, qos: QoSProfile) -> LifecyclePublisher:
        publisher: LifecyclePublisher = self._node.create_lifecycle_publisher(kind, topic, qos)
        self._publishers.append(publisher)
        return publisher

    def is_repeated(self, received_ns: int) -> bool:
        """Tell whether the preview had been played once before a time of the host [ns]."""
        since_ns = self._repeated_since_ns
        return since_ns is not None and received_ns >= since_ns

    def _played(self, states: Sequence[Previewed]) -> Iterator[Previewed]:
        self._repeated_since_ns = None
        yield from states
        self._repeated_since_ns = time.time_ns()
        yield from cycle(states)

    def _play_preview(self) -> None:
        # The first time it is played for the bag, too, which repeats nothing.
        is_seen = self._repeated_since_ns is None or self._viewers > 0
        shown = next(self._preview, None) if is_seen else None
        if shown is None or self._previewed is None:
            self._timer.cancel()
            return
        now = self._clock.now()
        shown.joints.header.stamp = now.to_msg()
        motion, body = self._previewed
        self.transforms.preview(motion, shown.time, now.nanoseconds, body)
        self._joint_states.publish(shown.joints)
