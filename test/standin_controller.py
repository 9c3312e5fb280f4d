"""A controller that keeps the documented rules of Jazzy's joint_trajectory_controller.

Written from its documentation and behaviour (ros-controls/ros2_controllers, branch jazzy): what it
refuses, where a goal's tolerances come from, how a goal ends, that a new goal replaces the one
that runs, that it runs the trajectory's time at `scaling`, and that it holds where it is after a
cancelled goal. The joints are where the trajectory wants them, but for `off`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from scipy.interpolate import BPoly
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.ros.messages.foreign import (
    FollowJointTrajectory,
    JointTrajectoryControllerState,
)

NAME = "joint_trajectory_controller"
RESULT = FollowJointTrajectory.Result
REST = float(np.finfo(np.float32).eps)
PERIOD = 0.01  # [s]


class StandInController:
    """The action and the parameters of a controller; to be spun with its node."""

    def __init__(self, joints: Sequence[str], namespace: str = "", **parameters: Any) -> None:
        self.joints, self.off = list(joints), 0.0  # of the first joint [rad]
        self.scaling = 1.0
        self.told_scaling: float | None = None  # None: as it is; controllers before 4.39 say 0.0
        self._followed: JointTrajectory | None = None
        self._path = BPoly([[0.0]], [0.0, 1.0])  # of its joints, in its order
        self._own_ns = 0  # the trajectory's time; zero before its first sample
        self._updated_ns = 0
        self._reference = np.zeros((2, len(self.joints)))  # positions and velocities
        self.refused: list[str] = []  # why, in the order of refusals
        self.trajectories: list[JointTrajectory] = []  # that were accepted
        self.accepted_ns: list[int] = []
        self._running: tuple[ServerGoalHandle, Future, dict[str, Any]] | None = None
        self._ends: dict[bytes, Future] = {}  # of goals that were accepted, by their ids
        self.node = Node(NAME, namespace=namespace)
        declared = {
            "joints": self.joints,
            "command_interfaces": ["position"],
            "state_interfaces": ["position", "velocity"],
            "allow_nonzero_velocity_at_trajectory_end": False,
            "constraints.goal_time": 0.0,
            "constraints.stopped_velocity_tolerance": 0.01,
        }
        for joint in self.joints:
            declared |= {f"constraints.{joint}.{what}": 0.0 for what in ("trajectory", "goal")}
        for name, value in (declared | parameters).items():
            self.node.declare_parameter(name, value)
        self._server = ActionServer(
            self.node,
            FollowJointTrajectory,
            f"{NAME}/follow_joint_trajectory",
            self._execute,
            goal_callback=self._decide,
            handle_accepted_callback=self._accept,
            cancel_callback=self._cancel,
        )
        self._state = self.node.create_publisher(
            JointTrajectoryControllerState, f"{NAME}/controller_state", 10
        )
        self.node.create_subscription(JointTrajectory, f"{NAME}/joint_trajectory", self._take, 1)
        self._timer = self.node.create_timer(PERIOD, self._update)

    def parameter(self, name: str) -> Any:
        return self.node.get_parameter(name).value

    def complaint(self, trajectory: JointTrajectory) -> str:
        """Why a trajectory is refused; empty: it is not."""
        names, points = trajectory.joint_names, trajectory.points
        if len(names) != len(self.joints) or not set(names) <= set(self.joints):
            return "joints"
        if not points:
            return "no points"
        if not self.parameter("allow_nonzero_velocity_at_trajectory_end") and any(
            abs(rate) > REST for rate in points[-1].velocities
        ):
            return "moves at its end"
        start_ns = nanoseconds(trajectory.header.stamp)
        if start_ns and start_ns + nanoseconds(points[-1].time_from_start) < self._now_ns():
            return "ends in the past"
        times = [nanoseconds(point.time_from_start) for point in points]
        if any(after <= before for before, after in pairwise(times)):
            return "times"
        for point in points:
            if len(point.positions) != len(names):
                return "positions"
            if any(
                len(row) not in (0, len(names)) for row in (point.velocities, point.accelerations)
            ):
                return "velocities or accelerations"
            if len(point.effort) and "effort" not in self.parameter("command_interfaces"):
                return "effort"
        return ""

    def hold(self) -> None:
        """Stop at the next update, and stay; any thread may ask for it."""
        self._followed = None

    def close(self) -> None:
        self._server.destroy()
        self.node.destroy_node()

    def _now_ns(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)

    def _take(self, trajectory: JointTrajectory) -> None:
        self.trajectories.append(trajectory)
        times = [nanoseconds(one.time_from_start) / NANOSECONDS for one in trajectory.points]
        rows = [[one.positions, one.velocities, one.accelerations] for one in trajectory.points]
        self._followed, self._path = trajectory, BPoly.from_derivatives(times, rows)
        self._own_ns = 0

    def _decide(self, goal: Any) -> GoalResponse:
        words = self.complaint(goal.trajectory)
        if words:
            self.refused.append(words)
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accept(self, handle: ServerGoalHandle) -> None:
        self._end("abort", RESULT.INVALID_GOAL, "Current goal preempted by new incoming action.")
        self._take(handle.request.trajectory)
        self.accepted_ns.append(self._now_ns())
        end = Future()
        self._ends[bytes(handle.goal_id.uuid)] = end
        self._running = handle, end, self._tolerances(handle.request)
        handle.execute()

    def _cancel(self, _: ServerGoalHandle) -> CancelResponse:
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        # It may have ended before it is executed.
        how, result = await self._ends.pop(bytes(handle.goal_id.uuid))
        getattr(handle, how)()
        return result

    def _end(self, how: str, code: int, words: str) -> None:
        if self._running is not None:
            _, future, _ = self._running
            self._running = None
            future.set_result((how, RESULT(error_code=code, error_string=words)))

    def _tolerances(self, goal: Any) -> dict[str, Any]:
        """The controller's, where the goal says nothing (0); none at all where it says -1."""

        def of(given: float, usual: float) -> float:
            return 0.0 if given == -1.0 else given or usual

        asked = {
            what: {one.name: one.position for one in getattr(goal, f"{kind}_tolerance")}
            for what, kind in (("trajectory", "path"), ("goal", "goal"))
        }
        found: dict[str, Any] = {
            what: [
                of(asked[what].get(joint, 0.0), self.parameter(f"constraints.{joint}.{what}"))
                for joint in self.joints
            ]
            for what in asked
        }
        # Seen by a controller that measures velocities and commands them, or efforts.
        stopped = self.parameter("constraints.stopped_velocity_tolerance")
        sees = "velocity" in self.parameter("state_interfaces") and not {
            "velocity",
            "effort",
        }.isdisjoint(self.parameter("command_interfaces"))
        rates = {one.name: one.velocity for one in goal.goal_tolerance}
        found["rates"] = [
            of(rates.get(joint, 0.0), stopped) if sees else 0.0 for joint in self.joints
        ]
        given = goal.goal_time_tolerance.sec + goal.goal_time_tolerance.nanosec / NANOSECONDS
        return found | {"time": of(given, self.parameter("constraints.goal_time"))}

    def _follow(self, now_ns: int) -> float:
        """Go on in the trajectory, and tell the reference; its own time since the start [s]."""
        passed, self._updated_ns = now_ns - self._updated_ns, now_ns
        since, followed = 0.0, self._followed
        if followed is None:
            self._reference[1] = 0.0
        else:
            self._own_ns = self._own_ns + round(passed * self.scaling) if self._own_ns else now_ns
            since = (self._own_ns - nanoseconds(followed.header.stamp)) / NANOSECONDS
            at = np.clip(since, self._path.x[0], self._path.x[-1])
            order = [followed.joint_names.index(joint) for joint in self.joints]
            self._reference = np.array([self._path(at), self._path.derivative()(at)])[:, order]
        told = self.scaling if self.told_scaling is None else self.told_scaling
        positions, velocities = self._reference
        stamp = Time(sec=now_ns // NANOSECONDS, nanosec=now_ns % NANOSECONDS)
        self._state.publish(
            JointTrajectoryControllerState(
                header=Header(stamp=stamp),
                joint_names=self.joints,
                reference=JointTrajectoryPoint(positions=positions, velocities=velocities),
                speed_scaling_factor=told,
            )
        )
        return since

    def _update(self) -> None:
        since = self._follow(self._now_ns())
        if self._running is None:
            return
        handle, _, tolerances = self._running
        trajectory = handle.request.trajectory
        times = [nanoseconds(one.time_from_start) / NANOSECONDS for one in trajectory.points]
        if handle.is_cancel_requested:
            self.hold()
            self._end("canceled", 0, "")
            return
        desired = list(self._reference[0])
        off = [self.off, *[0.0] * (len(self.joints) - 1)]
        handle.publish_feedback(
            FollowJointTrajectory.Feedback(
                joint_names=self.joints,
                desired=JointTrajectoryPoint(positions=desired),
                error=JointTrajectoryPoint(positions=off),
            )
        )

        def violated(what: str) -> bool:
            pairs = zip(off, tolerances[what], strict=True)
            return any(limit > 0.0 and abs(error) > limit for error, limit in pairs)

        # The joints stop at the last point, which the controller wants with its rates for ever.
        moves = any(
            limit > 0.0 and abs(rate) > limit
            for rate, limit in zip(
                trajectory.points[-1].velocities, tolerances["rates"], strict=True
            )
        )
        if since < times[-1]:
            if violated("trajectory"):
                self._end("abort", RESULT.PATH_TOLERANCE_VIOLATED, "Aborted due to path tolerance")
        elif not violated("goal") and not moves:
            self._end("succeed", RESULT.SUCCESSFUL, "Goal successfully reached!")
        elif tolerances["time"] and since - times[-1] > tolerances["time"]:
            self._end("abort", RESULT.GOAL_TOLERANCE_VIOLATED, "Aborted due to goal_time_tolerance")
