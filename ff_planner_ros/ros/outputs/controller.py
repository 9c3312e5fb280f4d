"""The arm's joint_trajectory_controller: its action, and whether it keeps a plan's times."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.parameters.controller import ControllerParameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.ros.inputs.raw_subscription import RawSubscription
from ff_planner_ros.ros.messages.foreign import (
    FollowJointTrajectory,
    JointTrajectoryControllerState,
)
from ff_planner_ros.ros.messages.to_messages import controller_goal

# While a goal runs, its controller is looked for so often; one that is away for so long is gone:
# discovery may lose it for a moment [s].
_PERIOD, _AWAY = 1.0, 3.0
# Its result is asked for again after so long, then after twice as long, and so on at most [s]: a
# controller that was started anew knows no goal, and says so. One that knows it answers all at the
# end.
_AGAIN, _SELDOM = 2.0, 60.0
_SOON_NS = 1_000_000
# The newest state is looked at so often while a plan runs [s]. What an earlier one would have shown
# stays: a controller that has lost time does not catch up.
_LOOK = 0.01
_ONE = 1e-3  # a speed_scaling_factor so near one leaves the plan as it is
# A reference off the plan's velocities counts by how far it will be off after so long [s].
_AHEAD = 0.1
_MOVES = 1e-6  # [rad/s, m/s]
_RESULT = FollowJointTrajectory.Result
_ERRORS = {
    getattr(_RESULT, name): name
    for name in (
        *("INVALID_GOAL", "INVALID_JOINTS", "OLD_HEADER_TIMESTAMP"),
        *("PATH_TOLERANCE_VIOLATED", "GOAL_TOLERANCE_VIOLATED"),
    )
}


@dataclass(frozen=True)
class Ended:
    """How a goal ended."""

    words: str
    succeeded: bool = False
    error_code: int = 0  # of FollowJointTrajectory's result; zero without a result
    # Whether the controller may have ended it because it got another one
    is_replaced: bool = False


@dataclass(eq=False)
class _Goal:
    """A goal that the controller has accepted, until its end."""

    handle: Any
    ended: Callable[[Ended], None]
    seen: float = field(default_factory=time.monotonic)  # when the controller was last there [s]
    asked: float = -_SELDOM  # when the result was last asked for [s]
    wait: float = _AGAIN / 2.0  # until it is asked for again [s]


class ControllerClient:
    """Sends plans to the controller's action, and reports when it accepts and ends them."""

    def __init__(
        self, node: Node, settings: ControllerParameters, group: MutuallyExclusiveCallbackGroup
    ) -> None:
        """Create the client of the action.

        Args:
            group: The callback group that `send` is called in. Responses come in it, too: rclpy 7.1
                loses one that comes before the request is noted, see `process.ask`.
        """
        self._settings, self._node = settings, node
        self._lock = threading.Lock()
        self._goals: list[_Goal] = []  # accepted, the last one last
        self._cancelled: list[_Goal] = []  # to be
        self.off: dict[str, float] = {}  # by what each joint is off its plan [rad, m]
        self._client = ActionClient(
            node, FollowJointTrajectory, settings.action, callback_group=group
        )
        # Steady: simulated time may stand still while a controller dies.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_PERIOD, self._look, group, clock)
        self._timer.cancel()  # until there is a goal

    @property
    def action(self) -> str:
        """Name of the action."""
        return self._settings.action

    @property
    def is_there(self) -> bool:
        """Whether the action can be reached."""
        return bool(self._client.server_is_ready())

    def send(
        self,
        trajectory: JointTrajectory,
        accepted: Callable[[], None],
        ended: Callable[[Ended], None],
    ) -> None:
        """Send a trajectory; a controller that accepts it drops its current goal.

        Args:
            accepted: Called when the controller accepts the trajectory.
            ended: Called once, when the trajectory is rejected or has ended.
        """
        if not self.is_there:
            ended(Ended(f"no controller answers at the action {self._settings.action}"))
            return
        sent = self._client.send_goal_async(
            controller_goal(trajectory, self._settings), lambda told: self._keep(told.feedback)
        )

        def answer(future: Any) -> None:
            handle = future.result()
            if not handle.accepted:
                ended(Ended("the controller refused it: its log says why"))
                return
            with self._lock:
                self._goals.append(_Goal(handle, ended))
                self.off = {}
            accepted()
            self._look_soon()

        sent.add_done_callback(answer)

    def cancel(self) -> None:
        """Cancel the goal that the controller has, if any."""
        with self._lock:
            self._cancelled = self._goals[-1:]
        self._look_soon()

    def close(self) -> None:
        """Remove the client from the node; the controller goes on."""
        self._node.destroy_timer(self._timer)
        self._client.destroy()

    def _look_soon(self) -> None:
        self._timer.timer_period_ns = _SOON_NS
        self._timer.reset()
        if self._node.executor is not None:
            self._node.executor.wake()

    def _look(self) -> None:
        """Ask for the results of goals, end those whose controller is gone, and cancel."""
        now, is_there = time.monotonic(), self.is_there
        with self._lock:
            goals, cancelled, self._cancelled = list(self._goals), self._cancelled, []
        for goal in cancelled:
            goal.handle.cancel_goal_async()
        for goal in goals:
            if is_there:
                goal.seen = now
            elif now > goal.seen + _AWAY:
                self._end(goal, Ended(f"its controller is gone from {self._settings.action}"))
            if is_there and now > goal.asked + goal.wait:
                goal.asked, goal.wait = now, min(2.0 * goal.wait, _SELDOM)
                self._ask(goal)
        with self._lock:
            self._timer.timer_period_ns = round(_PERIOD * NANOSECONDS)
            if not self._goals and not self._cancelled:
                self._timer.cancel()

    def _ask(self, goal: _Goal) -> None:
        goal.handle.get_result_async().add_done_callback(
            lambda result: self._end(goal, ended_by(result.result()))
        )

    def _end(self, goal: _Goal, how: Ended) -> None:
        with self._lock:
            if goal not in self._goals:
                return  # it has ended already
            self._goals.remove(goal)
        goal.ended(how)

    def _keep(self, feedback: Any) -> None:
        errors = map(abs, feedback.error.positions)
        self.off = dict(zip(feedback.joint_names, errors, strict=False))


def ended_by(response: Any) -> Ended:
    """Return how a goal ended, from the response of the action's result service."""
    code, said = response.result.error_code, response.result.error_string
    if response.status == GoalStatus.STATUS_SUCCEEDED:
        return Ended(f"the controller: {said or 'done'}", succeeded=True)
    if response.status == GoalStatus.STATUS_CANCELED:
        return Ended("the controller's goal was cancelled", error_code=code)
    if response.status == GoalStatus.STATUS_UNKNOWN:
        return Ended(
            "the controller that took it is gone: the one that is there knows no such goal"
        )
    name = _ERRORS.get(code, f"error {code}")
    words = f"the controller aborted it: {name}{': ' if said else ''}{said}"
    return Ended(words, error_code=code, is_replaced=code == _RESULT.INVALID_GOAL)


class _Followed(NamedTuple):
    """A plan as the controller is to follow it."""

    plan_id: str
    start_ns: int
    taken_ns: int
    joints: Sequence[str]
    motion: JointMotion


class ControllerWatch:
    """Compares a controller's reference, and its speed scaling, with the plan that runs."""

    def __init__(
        self, node: Node, settings: ControllerParameters, broken: Callable[[str, str, bool], None]
    ) -> None:
        """Subscribe to the controller's state; it is read while a plan is followed.

        Args:
            broken: Called with the id of a plan that the controller does not keep, with why, and
                with whether the controller may have ended its goal.
        """
        self._node, self._broken = node, broken
        self._tolerance = settings.reference_tolerance
        self._topic = node.resolve_topic_name(settings.watched_topic)
        self._unreadable = ""  # why the newest state could not be read; empty: it was
        self._plan: _Followed | None = None
        self._until_ns = 0  # the controller has had another trajectory from then on
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._states = RawSubscription(node, JointTrajectoryControllerState, self._topic, newest)
        # Steady: simulated time may stand still.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_LOOK, self._look, MutuallyExclusiveCallbackGroup(), clock)
        self._timer.cancel()  # until a plan runs

    @property
    def complaint(self) -> str:
        """Why the controller is not watched; empty: it is."""
        if not self._node.count_publishers(self._topic):
            return f"nobody publishes {self._topic}"
        return self._unreadable

    def follow(
        self, plan_id: str, start_ns: int, taken_ns: int, trajectory: JointTrajectory
    ) -> None:
        """Watch a plan, from its start and since the controller has it [ns]; not the one before."""
        joints, motion = trajectory.joint_names, _motion(trajectory)
        self._plan = _Followed(plan_id, start_ns, taken_ns, joints, motion)
        self._until_ns = start_ns + nanoseconds(trajectory.points[-1].time_from_start)
        self._timer.reset()

    def replaced(self, now_ns: int) -> None:
        """Compare no reference after a time [ns]: the controller is given another trajectory."""
        self._until_ns = min(self._until_ns, now_ns)

    def leave(self, plan_id: str) -> None:
        """Watch a plan no more."""
        if self._plan is not None and self._plan.plan_id == plan_id:
            self._plan = None

    def close(self) -> None:
        """Remove subscription and timer from the node."""
        self._node.destroy_timer(self._timer)
        self._states.close()

    def _look(self) -> None:
        plan = self._plan
        if plan is None:
            self._timer.cancel()
            return
        taken = self._states.take()
        if not taken:
            return
        self._unreadable = ""
        try:
            state = deserialize_message(taken[0][0], JointTrajectoryControllerState)
            scaled = self._scaling(state, plan)
            why = scaled or self._deviation(state, plan)
        except (RuntimeError, ValueError, IndexError) as error:
            # Of a control_msgs with other fields, or of another controller.
            self._unreadable = f"{self._topic} cannot be read: {error}"
            return
        if why:
            self._plan = None
            self._broken(plan.plan_id, why, not scaled)

    def _scaling(self, state: JointTrajectoryControllerState, plan: _Followed) -> str:
        """Return words on a plan that is not run at its own times; empty: it is."""
        if nanoseconds(state.header.stamp) < plan.start_ns:
            return ""
        # control_msgs before 5.3 have no such field; Jazzy's controller before 4.39 leaves it zero.
        factor = getattr(state, "speed_scaling_factor", 1.0)
        if not factor or abs(factor - 1.0) <= _ONE:
            return ""
        return (
            f"the controller runs it at {factor:.3g} of its speed (speed_scaling_factor of "
            f"{self._topic}), and it holds at its own times alone"
        )

    def _deviation(self, state: JointTrajectoryControllerState, plan: _Followed) -> str:
        """Return by what a reference is off a plan; empty: it is on it."""
        stamp_ns = nanoseconds(state.header.stamp)
        if not max(plan.start_ns, plan.taken_ns) <= stamp_ns <= self._until_ns:
            return ""
        seconds = (stamp_ns - plan.start_ns) / NANOSECONDS
        positions, rates = (one[0] for one in plan.motion.at(np.array([seconds]))[:2])
        order = [list(state.joint_names).index(name) for name in plan.joints]
        wanted = np.array(state.reference.positions)[order]
        wanted_rates = np.array(state.reference.velocities)[order]
        off = np.abs(wanted - positions) + _AHEAD * np.abs(wanted_rates - rates)
        joint = int(off.argmax())
        if not off[joint] > self._tolerance:
            return ""
        stands = np.abs(wanted_rates).max() < _MOVES < np.abs(rates).max()
        return (
            f"the controller{' has stopped: it' if stands else ''} wants {plan.joints[joint]} at "
            f"{wanted[joint]:.6f} with {wanted_rates[joint]:.6f}/s, {seconds:.3f} s after the "
            f"start, where the plan has {positions[joint]:.6f} with {rates[joint]:.6f}/s "
            f"(controller.reference_tolerance {self._tolerance:g})"
        )


def _motion(trajectory: JointTrajectory) -> JointMotion:
    """Return the motion as the controller interpolates it, from the start of the trajectory."""
    points = trajectory.points
    return JointMotion(
        np.array([nanoseconds(point.time_from_start) / NANOSECONDS for point in points]),
        *(
            np.array([getattr(point, name) for point in points])
            for name in ("positions", "velocities", "accelerations")
        ),
    )
