"""The planner as a client of a joint_trajectory_controller: its action, and its parameters."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from rclpy.action import ActionClient
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.parameters.controller import ERASED, ControllerParameters
from ff_planner_ros.planning.task.controller_rules import REST
from ff_planner_ros.ros.messages.foreign import FollowJointTrajectory, JointTolerance

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


class ControllerClient:
    """Sends plans to the controller's action, and reports when it accepts and ends them."""

    def __init__(self, node: Node, settings: ControllerParameters) -> None:
        """Create the client of the action."""
        self._settings, self._logger = settings, node.get_logger()
        self._lock = threading.Lock()
        self._handle: Any = None  # of the goal that was accepted last; None: none
        self.off: dict[str, float] = {}  # by what each joint is off its plan [rad, m]
        self._client = ActionClient(
            node,
            FollowJointTrajectory,
            settings.action,
            callback_group=MutuallyExclusiveCallbackGroup(),
        )

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
                self._handle, self.off = handle, {}
            accepted()
            handle.get_result_async().add_done_callback(
                lambda result: ended(ended_by(result.result()))
            )

        sent.add_done_callback(answer)

    def cancel(self) -> None:
        """Cancel the goal that the controller has, if any."""
        with self._lock:
            handle, self._handle = self._handle, None
        if handle is not None:
            handle.cancel_goal_async()

    def close(self) -> None:
        """Remove the client from the node; the controller goes on."""
        self._client.destroy()

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
