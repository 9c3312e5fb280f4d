"""Publishes plans for controllers and visualisation, and predictions while a plan runs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PublishedPlan as PublishedPlanMessage
from ff_planner_msgs.msg import TrackingError
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from std_msgs.msg import Header, String

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Trajectory, WheelMotion
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.to_messages import controller_message, time_message
from ff_planner_ros.ros.outputs import prediction
from ff_planner_ros.ros.outputs.execution import Execution
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.preview import Preview
from ff_planner_ros.ros.outputs.transforms import Transforms
from ff_planner_ros.ros.qos import create_lifecycle_publisher
from ff_planner_ros.ros.topics import (
    JOINT_TRAJECTORY,
    PREDICTED_CHASER_PATH,
    PREDICTED_CHASER_POSE,
    PREDICTED_RELATIVE_POSE,
    PREDICTED_TARGET_PATH,
    PREDICTED_WHEEL_MOMENTUM,
    PUBLISHED_PLAN,
    ROBOT_DESCRIPTION,
    TRACKING_ERROR,
    Endpoint,
)


@dataclass(frozen=True, eq=False)
class PublishedPlan:
    """A plan that was published."""

    plan_id: str
    trajectory: Trajectory
    start_ns: int  # time of the first point [ns]
    captured: CapturedBody | None = None  # None: it captures none
    duration: float | None = None  # from the first point to the goal [s]; None: to the last point
    before: PublishedPlan | None = None  # plan that is followed until this one starts; None: none
    wheels: WheelMotion | None = None  # reaction wheels of the chaser; None: there are none

    @property
    def seconds_to_goal(self) -> float:
        """Time from the first point to the goal [s]."""
        return float(self.trajectory.time[-1]) if self.duration is None else self.duration

    @property
    def end_ns(self) -> int:
        """Time of the last point [ns]."""
        return self.start_ns + round(float(self.trajectory.time[-1]) * NANOSECONDS)

    def at(self, time_ns: int) -> PublishedPlan | None:
        """Return the plan that runs at a time [ns]: this one, one before it, or None."""
        if time_ns < self.start_ns:
            return None if self.before is None else self.before.at(time_ns)
        return self if time_ns <= self.end_ns else None

    def until(self, plan_id: str, now_ns: int) -> PublishedPlan | None:
        """Return the plan of an id, this one or one before it, as the next one's `before`.

        It knows only those before it that are followed now [ns] or later.
        """
        before = self.before
        if self.plan_id != plan_id:
            return None if before is None else before.until(plan_id, now_ns)
        is_ahead = now_ns < self.start_ns
        kept = before.until(before.plan_id, now_ns) if is_ahead and before is not None else None
        return replace(self, before=kept)

    def without(self, plan_id: str) -> PublishedPlan:
        """Return the plan as if another one before it had not been published."""
        before = self.before
        if before is None:
            return self
        if before.plan_id == plan_id:
            return replace(self, before=before.before)
        return replace(self, before=before.without(plan_id))

    def motion(self, since_ns: int) -> JointMotion:
        """Return the joint motion, with its time counted from since_ns [ns]."""
        # The controller was told whole nanoseconds, and so was the bag, which a replay starts from.
        told = np.rint(self.trajectory.time * NANOSECONDS) / NANOSECONDS
        start = (self.start_ns - since_ns) / NANOSECONDS
        return joint_motion(replace(self.trajectory, time=told), start)


class PlanOutput:
    """Publishes plans and predictions while the node is active; remembers the last plan."""

    def __init__(self, node: LifecycleNode, robot: Robot, parameters: NodeParameters) -> None:
        """Create the publishers, which are silent until the node is active."""
        self._robot, self._frame = robot, parameters.inertial_frame
        self._takes_torques = parameters.controller.effort_interface
        self.transforms = Transforms(node, robot, parameters)
        self.execution = Execution(node, parameters.controller, self._forget_plan)
        self.preview = Preview(node, self.transforms, parameters)
        self._clock = node.get_clock()
        self._plans: list[PublishedPlan] = []  # that run, or will, and the last one; as published
        self._lock = threading.Lock()
        self.tracking: Sequence[prediction.Deviation] = ()  # empty while no plan runs
        self.published_one: Callable[[], None] = lambda: None  # called after a plan has gone out
        self._node = node
        self._publishers: list[LifecyclePublisher] = [
            *self.transforms.publishers,
            *self.execution.publishers,
            *self.preview.publishers,
        ]
        self._trajectory = self._publisher(JOINT_TRAJECTORY)
        self._published_plan = self._publisher(PUBLISHED_PLAN)
        self._path = self._publisher(PREDICTED_CHASER_PATH)
        self._pose = self._publisher(PREDICTED_CHASER_POSE)
        self._target_path = self._publisher(PREDICTED_TARGET_PATH)
        self._relative_pose = self._publisher(PREDICTED_RELATIVE_POSE)
        self._wheels = self._publisher(PREDICTED_WHEEL_MOMENTUM)
        self._tracking_error = self._publisher(TRACKING_ERROR)
        self._description = self._publisher(ROBOT_DESCRIPTION)

    def describe_robot(self, urdf: str) -> None:
        """Publish the text of the robot's URDF file; to be called when the node becomes active."""
        self._description.publish(String(data=urdf))
        self.transforms.describe()

    def publish(
        self,
        made: MadePlan,
        written: PlanMessage,
        requester: str,
    ) -> None:
        """Publish a plan for controllers and executives; `written` is its message."""
        for_controller = controller_message(written.joint_trajectory, self._takes_torques)
        self._trajectory.publish(for_controller)
        self._published_plan.publish(
            PublishedPlanMessage(
                header=Header(stamp=self._clock.now().to_msg(), frame_id=self._frame),
                plan_id=made.plan_id,
                requester=requester,
                start_time=for_controller.header.stamp,
                joint_trajectory=for_controller,
                end_behaviour=made.end_behaviour,
            )
        )
        self._path.publish(written.chaser_path)
        plan, captured = made.plan, made.captured
        if captured is not None:
            self._target_path.publish(written.target_path)
        start_ns = nanoseconds(for_controller.header.stamp)
        last, now_ns = self.published, self._clock.now().nanoseconds
        before = None if last is None else last.until(made.previous_plan_id, now_ns)
        new = PublishedPlan(
            made.plan_id, plan.trajectory, start_ns, captured, plan.duration, before, plan.wheels
        )
        with self._lock:
            self._plans = [*self._kept(), new]
        goal_ns = start_ns + round(new.seconds_to_goal * NANOSECONDS)
        self.execution.published(made.plan_id, start_ns, goal_ns, for_controller)
        self.transforms.published(captured)
        self.published_one()

    @property
    def published(self) -> PublishedPlan | None:
        """The last plan that was published and not aborted; None: there is none."""
        plans = self._plans
        return plans[-1] if plans else None

    @property
    def is_streamed(self) -> bool:
        """Whether a plan runs, or will; if not, `tracking` becomes empty."""
        published, now_ns = self.published, self._clock.now().nanoseconds
        runs = published is not None and (
            now_ns <= published.start_ns or published.at(now_ns) is not None
        )
        if not runs:
            self.tracking = ()
        return runs

    def stream(self, measured: Snapshot | None) -> None:
        """Publish the plan's predictions for now, and the tracking error of a measured state."""
        last, self.tracking = self.published, ()
        if last is None:
            return
        now_ns = self._clock.now().nanoseconds
        running = last.at(now_ns) or last
        motion, start_ns = running.trajectory, running.start_ns
        pose = prediction.predicted_chaser_pose(motion, start_ns, now_ns, self._frame)
        if pose is not None:
            self._pose.publish(pose)
        self.transforms.predicted(motion, start_ns, now_ns, running.captured)
        if running.captured is not None:
            relative = prediction.predicted_relative_pose(
                motion, start_ns, now_ns, running.captured
            )
            if relative is not None:
                self._relative_pose.publish(relative)
        if running.wheels is not None:
            held = prediction.predicted_wheels(
                motion.time, running.wheels, start_ns, now_ns, self._robot.base_link
            )
            if held is not None:
                self._wheels.publish(held)
        if measured is None:
            return
        time = (measured.stamp_ns - start_ns) / NANOSECONDS
        self.tracking = prediction.deviations(measured.state, motion, time, self._robot)
        if self.tracking:
            position, angle = (one.amount for one in self.tracking[:2])
            stamp = time_message(measured.stamp_ns)
            self._tracking_error.publish(
                TrackingError(
                    header=Header(stamp=stamp, frame_id=self._frame),
                    plan_id=running.plan_id,
                    position=position,
                    angle=angle,
                )
            )

    def forget(self, why: str) -> None:
        """Forget the last plan and abort all plans: their times are no longer the clock's."""
        self._plans, self.tracking = [], ()
        self.execution.forget(why)

    def close(self) -> None:
        """Remove timers and publishers from the node."""
        self.preview.close()
        self.execution.close()
        for publisher in self._publishers:
            self._node.destroy_lifecycle_publisher(publisher)

    def _forget_plan(self, plan_id: str) -> None:
        """Forget a plan that was aborted; what the controller still follows, or will, stays."""
        with self._lock:
            kept = [one for one in self._kept() if one.plan_id != plan_id]
            self._plans = [one.without(plan_id) for one in kept]
        self.tracking = ()

    def _kept(self) -> list[PublishedPlan]:
        """Return the plans that run, or will, and the last one."""
        earlier = [one for one in self._plans[:-1] if self.execution.runs(one.plan_id)]
        return earlier + self._plans[-1:]

    def _publisher(self, endpoint: Endpoint) -> LifecyclePublisher:
        publisher = create_lifecycle_publisher(self._node, endpoint)
        self._publishers.append(publisher)
        return publisher
