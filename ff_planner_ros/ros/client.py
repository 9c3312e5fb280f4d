"""A client of a running node: requests and their answers, publication, and what it tells."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeAlias, cast

import rclpy
from action_msgs.msg import GoalStatus
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import PlanAnswer, PlanProgress, PlanRequest, PlanStatus
from ff_planner_msgs.srv import PublishPlan
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.ros.process import ask, joining_ros, spin_in_background
from ff_planner_ros.ros.qos import qos_profile
from ff_planner_ros.ros.topics import ACTION, PUBLISH_PLAN, Endpoint

# Called while something is waited for; raises to end the wait.
Check: TypeAlias = Callable[[], None]
_INTERVAL = 0.1  # [s] between two calls of it
_PATIENCE = 5.0  # for an answer that takes no planning [s]


def nothing() -> None:
    """Let the wait go on."""


class Planning:
    """A request that a node has, until its answer."""

    def __init__(self, client: PlannerClient, sent: Future[Any]) -> None:
        """Wrap the future goal handle of the action; made by `PlannerClient.ask`."""
        self._client, self.sent = client, sent
        self.goal_status = GoalStatus.STATUS_UNKNOWN  # of the action, once there is an answer

    def answer(self, check: Check = nothing) -> PlanAnswer:
        """Wait for the answer; whoever stops waiting has the node cancel the request.

        Args:
            check: Called repeatedly while waiting; raises to end the wait.

        Raises:
            FfPlannerError: The node ends before it answers.
        """
        try:
            handle = self._client.waited(self.sent, check)
            response = self._client.waited(
                ask(self._client.executor, handle.get_result_async), check
            )
        except BaseException:
            if self._client.is_there:
                self.cancel()
            raise
        self.goal_status, answer = response.status, response.result.answer
        return cast(PlanAnswer, answer)

    def cancel(self, patience: float = _PATIENCE) -> bool:
        """Have the node cancel the request; return whether it does.

        Args:
            patience: Longest wait for that answer [s]; later it is False.
        """
        until = time.monotonic() + patience
        with suppress(TimeoutError):
            handle = self.sent.result(patience)
            asked = ask(self._client.executor, handle.cancel_goal_async)
            return bool(asked.result(max(until - time.monotonic(), 0.0)).goals_canceling)
        return False


class PlannerClient:
    """A client of one planner node, with a ROS node and a thread of its own.

    rclpy 7.1 loses a response that comes before its request has been noted, and `spin_until_
    future_complete` leaks: here every request is sent by the thread that receives the responses.
    Any thread may call the methods, but for that of the callbacks.
    """

    def __init__(
        self,
        name: str,
        ros_arguments: Sequence[str] = (),
        planner: str = "ff_planner",
        namespace: str | None = None,
        context: Context | None = None,
    ) -> None:
        """Join ROS.

        Args:
            name: Name of the client's node.
            ros_arguments: Arguments of ROS, for instance `--ros-args -r __ns:=/chaser_1`.
            planner: Name of the planner's node, as seen from the namespace of the client's.
            context: Of ROS, to be initialised here; None: one of its own.

        Raises:
            InvalidInput: rclpy refuses the arguments, or security cannot be had.
        """
        self._context = context or Context()
        with joining_ros():
            rclpy.init(
                args=[sys.argv[0], *ros_arguments],
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self.node = rclpy.create_node(name, namespace=namespace, context=self._context)
        # A burst of answers waits at the client; the middleware would drop all but ten.
        queued = {f"{of}_service_qos_profile": qos_profile(ACTION) for of in ("goal", "result")}
        self._action = ActionClient(self.node, PlanTrajectory, ACTION.name, **queued)
        self._services: dict[str, Client] = {}
        publish = PUBLISH_PLAN.name.replace("~", planner)
        self._publication = self._service(PublishPlan, publish)
        self.executor = SingleThreadedExecutor(context=self._context)
        self.executor.add_node(self.node)
        self._stop = spin_in_background(self.executor, self.node.get_logger())

    def close(self) -> None:
        """Leave ROS."""
        self._stop()
        self._action.destroy()
        self.node.destroy_node()  # or else the middleware tells of its publishers for long
        rclpy.try_shutdown(context=self._context)

    @property
    def is_there(self) -> bool:
        """Whether a node offers the action."""
        return bool(self._action.server_is_ready())

    def wait_for_planner(self, patience: float, check: Check = nothing) -> None:
        """Wait until a node offers the action.

        Args:
            patience: Longest wait [s].
            check: Called repeatedly while waiting; raises to end the wait.

        Raises:
            InvalidInput: No node offers it.
        """
        self._wait_for(self._action.wait_for_server, "action", ACTION.name, patience, check)

    def ask(
        self, request: PlanRequest, progress: Callable[[PlanProgress], None] | None = None
    ) -> Planning:
        """Send a request, and return at once.

        Args:
            progress: Called with the progress of the search, in the thread of the callbacks.
        """
        goal = PlanTrajectory.Goal(request=request)
        heard = None
        if progress is not None:
            heard = lambda message: progress(message.feedback.progress)  # noqa: E731
        return Planning(self, ask(self.executor, lambda: self._action.send_goal_async(goal, heard)))

    def plan(
        self,
        request: PlanRequest,
        progress: Callable[[PlanProgress], None] | None = None,
        check: Check = nothing,
    ) -> PlanAnswer:
        """Send a request and return its answer; see `ask` and `Planning.answer`."""
        return self.ask(request, progress).answer(check)

    def publish(
        self,
        plan_id: str,
        requester: str,
        reject: bool = False,
        patience: float = _PATIENCE,
        check: Check = nothing,
    ) -> PlanStatus:
        """Have the node publish, or drop, a plan that waits for that; return what comes of it.

        Raises:
            InvalidInput: No node offers the service.
            FfPlannerError: The node does not answer.
        """
        request = PublishPlan.Request(plan_id=plan_id, requester=requester, reject=reject)
        response = self._called(self._publication, request, patience, check)
        return cast(PlanStatus, response.status)

    def call(self, kind: type, service: str, request: Any, patience: float) -> Any:
        """Call any service, and return its response.

        Raises:
            InvalidInput: No node offers the service.
            FfPlannerError: Its node does not answer.
        """
        return self._called(self._service(kind, service), request, patience, nothing)

    def parameters(self, node: str, names: Sequence[str], patience: float) -> dict[str, Any]:
        """Return parameters of any node that has them all, as a parameters file has them.

        Raises:
            InvalidInput: There is no such node.
            FfPlannerError: It does not answer.
        """
        request = GetParameters.Request(names=list(names))
        answer = self.call(GetParameters, f"{node}/get_parameters", request, patience)
        values = map(parameter_value_to_python, answer.values)
        return {
            name: one if isinstance(one, str | bool | int | float | None) else list(one)
            for name, one in zip(names, values, strict=True)
        }

    def hear(
        self, topic: Endpoint, heard: Callable[[Any], None], from_now_on: bool = False
    ) -> None:
        """Call `heard` with the messages of a topic, in the thread of the callbacks.

        Args:
            topic: Of the table `ros.topics`, for instance `PLAN_EVENTS`.
            from_now_on: Not with those that the node keeps for whoever comes late.
        """
        qos = qos_profile(topic)
        if from_now_on:
            qos.durability = DurabilityPolicy.VOLATILE
        self.node.create_subscription(topic.message_type, topic.name, heard, qos)

    def now_ns(self) -> int:
        """Return the time by the client's clock [ns]."""
        return int(self.node.get_clock().now().nanoseconds)

    def waited(self, response: Future[Any], check: Check) -> Any:
        """Return a response of the planner's node.

        Raises:
            FfPlannerError: The node is gone.
        """

        def is_alive() -> None:
            check()
            if not self.is_there:
                raise FfPlannerError(Status.SHUT_DOWN, "the node ended before it answered")

        return _result(response, is_alive)

    def _service(self, kind: type, name: str) -> Client:
        """Return the client of a service; one that is new may miss the first answer."""
        if name not in self._services:
            queued = qos_profile(PUBLISH_PLAN)
            self._services[name] = self.node.create_client(kind, name, qos_profile=queued)
        return self._services[name]

    def _called(self, client: Client, request: Any, patience: float, check: Check) -> Any:
        until, service = time.monotonic() + patience, client.srv_name
        self._wait_for(client.wait_for_service, "service", service, patience, check)

        def is_in_time() -> None:
            check()
            if time.monotonic() > until:
                words = f"{service} did not answer within {patience:g} s"
                raise FfPlannerError(Status.NOT_ACTIVE, words)

        return _result(ask(self.executor, lambda: client.call_async(request)), is_in_time)

    def _wait_for(
        self,
        is_there: Callable[[float], bool],
        what: str,
        name: str,
        patience: float,
        check: Check,
    ) -> None:
        until = time.monotonic() + patience
        while not is_there(_INTERVAL):
            check()
            if time.monotonic() > until:
                domain = os.environ.get("ROS_DOMAIN_ID", "0")
                allowed = (
                    f"no node offers it within {patience:g} s: does one run, active, in ROS domain "
                    f"{domain} and this namespace?"
                )
                raise InvalidInput(Status.NOT_ACTIVE, what, name, allowed)


def _result(response: Future[Any], check: Check) -> Any:
    while True:
        try:
            return response.result(_INTERVAL)  # so that a signal is handled meanwhile
        except TimeoutError:
            check()
