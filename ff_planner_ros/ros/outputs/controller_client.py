"""The planner as a client of a joint_trajectory_controller: its action, and its parameters."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from rclpy.action import ActionClient
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.parameters.controller import ERASED, ControllerParameters
from ff_planner_ros.planning.task.controller_rules import REST
from ff_planner_ros.ros.messages.foreign import FollowJointTrajectory, JointTolerance

# While a goal runs, its controller is looked for so often; one that is away for so long is gone:
# discovery may lose it for a moment [s].
_PERIOD, _AWAY = 1.0, 3.0
# Its result is asked for again after so long, then after twice as long, and so on at most [s]: a
# controller that was started anew knows no goal, and says so. One that knows it answers all at the
# end.
_AGAIN, _SELDOM = 2.0, 60.0
_SOON_NS = 1_000_000
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
                loses one that comes before the request is noted, see `background.ask`.
        """
        self._settings, self._logger, self._node = settings, node.get_logger(), node
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
            goal_of(trajectory, self._settings), lambda told: self._keep(told.feedback)
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


def goal_of(trajectory: JointTrajectory, settings: ControllerParameters) -> Any:
    """Return the goal for a trajectory, with the tolerances of the parameters."""
    nanoseconds = round(settings.goal_time_tolerance * NANOSECONDS)
    return FollowJointTrajectory.Goal(
        trajectory=trajectory,
        path_tolerance=_tolerances(trajectory, settings.path_tolerance),
        goal_tolerance=_goal_tolerances(trajectory, settings.goal_tolerance),
        goal_time_tolerance=Duration(
            sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS
        ),
    )


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


def _goal_tolerances(trajectory: JointTrajectory, position: float) -> list[Any]:
    """Return the tolerances at the end, where joints that are to move need not have stopped."""
    told = {one.name: one for one in _tolerances(trajectory, position)}
    for point in trajectory.points[-1:]:
        for name, rate in zip(trajectory.joint_names, point.velocities, strict=False):
            if abs(rate) > REST:
                told.setdefault(name, JointTolerance(name=name)).velocity = ERASED
    return list(told.values())


def _tolerances(trajectory: JointTrajectory, position: float) -> list[Any]:
    """Return one tolerance for every joint; none at zero: the controller's own then holds."""
    if not position:
        return []
    return [JointTolerance(name=name, position=position) for name in trajectory.joint_names]
