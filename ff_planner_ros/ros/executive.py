"""A mission executive reduced to its one question to the planner."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import rclpy
from ff_planner_msgs.msg import ChaserState
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.ros.background import spin_in_background
from ff_planner_ros.ros.planning_service import STATE_QOS

# Refusals that pass by themselves while the system starts: worth another try at the next state.
_NOT_YET = frozenset({Status.NO_STATE, Status.NO_OBSTACLES, Status.STATE_TOO_OLD})
_CHECK_INTERVAL = 0.2  # [s] between looks at the other processes while waiting


class MissionExecutive:
    """A client of the planning service."""

    def __init__(self, check: Callable[[], None], patience: float) -> None:
        """Join ROS.

        Args:
            check: Called again and again while waiting; raises when waiting makes no sense.
            patience: Longest wait for the service and an answer [s].
        """
        self._check = check
        self._patience = patience
        self._new_state = threading.Event()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("mission_executive")
        node.create_subscription(
            ChaserState, "chaser_state", lambda _: self._new_state.set(), STATE_QOS
        )
        self._client = node.create_client(PlanTrajectory, "plan_trajectory")
        # A thread of its own and an event: spinning until a future is complete leaks in Jazzy.
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        self._stop = spin_in_background(executor, node.get_logger())

    def close(self) -> None:
        """Leave ROS."""
        self._stop()
        rclpy.shutdown()

    def plan(self, request: PlanTrajectory.Request) -> PlanTrajectory.Response:
        """Ask the planner, as soon as it is there and has heard of the chaser.

        Args:
            request: The question.

        Returns:
            An answer whose status is SOLVED.

        Raises:
            FfPlannerError: The planner's refusal, or no answer in time.
        """
        deadline = time.monotonic() + self._patience
        while not self._client.wait_for_service(timeout_sec=_CHECK_INTERVAL):
            self._go_on_until(deadline, "the service plan_trajectory")
        while True:
            self._new_state.clear()
            response = self._answer(request, deadline)
            status = Status(response.status.code)
            if status is Status.SOLVED:
                return response
            if status not in _NOT_YET or time.monotonic() > deadline:
                raise FfPlannerError(status, response.status.message)
            self._wait(self._new_state, deadline, "a chaser state")

    def _answer(self, request: PlanTrajectory.Request, deadline: float) -> PlanTrajectory.Response:
        answered = threading.Event()
        future = self._client.call_async(request)
        future.add_done_callback(lambda _: answered.set())
        self._wait(answered, deadline, "an answer of the planner")
        return future.result()

    def _wait(self, event: threading.Event, deadline: float, what: str) -> None:
        while not event.wait(_CHECK_INTERVAL):
            self._go_on_until(deadline, what)

    def _go_on_until(self, deadline: float, what: str) -> None:
        self._check()
        if time.monotonic() > deadline:
            raise FfPlannerError(
                Status.INTERNAL_ERROR, f"{what} did not come within {self._patience:g} s"
            )
