"""Requests to a running node: the console's through the action, others' from its events."""

from __future__ import annotations

import threading
import uuid
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.action import ActionClient

from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.live.link import REQUESTER, Link
from ff_planner_ros.console.live.plans import Plans
from ff_planner_ros.console.search import best_in_words
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.plans import metrics_from_message
from ff_planner_ros.messages.service_events import (
    GOAL_EVENTS,
    REQUEST_RECEIVED,
    RESULT_EVENTS,
    SERVICE_EVENTS,
)
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.background import ask
from ff_planner_ros.ros.client import RefusedGoals, request_of_task
from ff_planner_ros.ros.messages.interfaces import ACTION, GET_RESULT, SEND_GOAL, SERVICE
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.qos import EVENT_QOS

_INTERVAL = 0.1  # [s] between looks at whether it is cancelled, or the node lost
_MOST_OPEN = 100  # requests of others whose answers have not come


def request_of(task: PlanningTask, frame: str, start_ns: int) -> PlanRequest:
    """Return the request for a plan that waits for approval, from the node's state and scene.

    Args:
        start_ns: Start time of the plan [ns]; zero: as soon as the node can.
    """
    request = request_of_task(task, frame)
    request.start_time = time_message(start_ns)
    request.plan_only, request.requester = True, REQUESTER
    return request


class Requests:
    """Requests plans of the node, and listens to the requests of other clients."""

    def __init__(
        self,
        link: Link,
        plans: Plans,
        start_ns: Callable[[], int],
        heard: Callable[[PlanRequest, PlanAnswer], None],
    ) -> None:
        """Create the action client, and subscribe to the events of service and action.

        Args:
            start_ns: Returns the start time for a plan that is requested now [ns]; zero: as soon as
                the node can.
            heard: Called with each request of other clients and its answer.
        """
        self._link, self._plans, self._start_ns, self._heard = link, plans, start_ns, heard
        self._own = set[bytes]()
        self._open: OrderedDict[Any, PlanRequest] = OrderedDict()
        self._client = ActionClient(link.node, PlanTrajectoryAction, ACTION)
        self._refused = RefusedGoals(link.node)
        hear = link.node.create_subscription
        hear(SEND_GOAL.Event, f"{ACTION}{GOAL_EVENTS}", self._goal_sent, EVENT_QOS)
        hear(GET_RESULT.Event, f"{ACTION}{RESULT_EVENTS}", self._result_sent, EVENT_QOS)
        hear(PlanTrajectory.Event, f"{SERVICE}{SERVICE_EVENTS}", self._served, EVENT_QOS)

    def __call__(
        self, task: PlanningTask, told: Callable[[str], None], done: Callable[[Entry], None]
    ) -> Asked:
        """Request a plan; see `console.entries.Begin`."""
        request = request_of(task, self._link.parameters.inertial_frame, self._start_ns())
        key = uuid.uuid4().bytes
        self._own.add(key)

        def answered(answer: PlanAnswer) -> None:
            done(self._plans.answered(request, answer, task))

        def failed(error: FfPlannerError) -> None:
            status = f"refused, {error.status.name}"
            done(Entry("not planned", task, error=error, status=status, words=str(error)))

        goal = PlanTrajectoryAction.Goal(request=request)
        return Asked(self._link, self._client, self._refused, goal, key, told, answered, failed)

    def close(self) -> None:
        """Destroy the action client."""
        self._client.destroy()

    def _goal_sent(self, event: Any) -> None:
        for asked in event.request:
            self._remember(bytes(asked.goal_id.uuid), asked.goal.request)

    def _result_sent(self, event: Any) -> None:
        for asked, told in zip(event.request, event.response, strict=False):
            self._answer(bytes(asked.goal_id.uuid), told.result.answer)

    def _served(self, event: Any) -> None:
        key = bytes(np.asarray(event.info.client_gid)), event.info.sequence_number
        if event.info.event_type == REQUEST_RECEIVED:
            for asked in event.request:
                self._remember(key, asked.request)
        for told in event.response:
            self._answer(key, told.answer)

    def _remember(self, key: Any, request: PlanRequest) -> None:
        if key not in self._own:
            self._open[key] = request
            while len(self._open) > _MOST_OPEN:
                self._open.popitem(last=False)

    def _answer(self, key: Any, answer: PlanAnswer) -> None:
        request = self._open.pop(key, None)
        if request is not None:
            self._heard(request, answer)


class Asked:
    """A request of the console to the node, which is sent at once."""

    def __init__(
        self,
        link: Link,
        client: ActionClient,
        refused: RefusedGoals,
        goal: PlanTrajectoryAction.Goal,
        key: bytes,
        told: Callable[[str], None],
        answered: Callable[[PlanAnswer], None],
        failed: Callable[[FfPlannerError], None],
    ) -> None:
        """Send the request.

        Args:
            key: Id of the goal, 16 bytes.
            told: Called with the progress in words.
            answered: Called once, with the answer.
            failed: Called once instead, with the reason why there is no answer.
        """
        self._link, self._client, self._refused = link, client, refused
        self._goal, self._key, self._told = goal, key, told
        self._answered, self._failed = answered, failed
        self._cancelled = threading.Event()
        self._thread = threading.Thread(target=self._run, name="console request", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Have the node cancel the request."""
        self._cancelled.set()

    def wait(self) -> None:
        """Wait until the request was answered or has failed."""
        self._thread.join()

    def _run(self) -> None:
        try:
            answer = self._result()
        except FfPlannerError as error:
            self._failed(error)
        except Exception as defect:  # whatever nobody thought of, so that the page goes on
            words = f"{type(defect).__name__}: {defect}"
            self._failed(FfPlannerError(Status.INTERNAL_ERROR, words))
        else:
            self._answered(answer)

    def _result(self) -> PlanAnswer:
        if lost := self._link.lost:
            raise FfPlannerError(Status.NOT_ACTIVE, lost)
        executor, goal_id = self._link.executor, SEND_GOAL.Request().goal_id
        goal_id.uuid = list(self._key)
        sent = ask(
            executor, lambda: self._client.send_goal_async(self._goal, self._progress, goal_id)
        )
        handle = self._waited(sent)
        self._refused.require_accepted(handle)
        result = ask(executor, handle.get_result_async)
        answer: PlanAnswer = self._waited(
            result, lambda: ask(executor, handle.cancel_goal_async)
        ).result.answer
        return answer

    def _waited(self, answer: Future[Any], cancel: Callable[[], object] | None = None) -> Any:
        while True:
            try:
                return answer.result(_INTERVAL)
            except TimeoutError:
                if lost := self._link.lost:
                    raise FfPlannerError(Status.SHUT_DOWN, lost) from None
            if cancel is not None and self._cancelled.is_set():
                cancel()
                cancel = None

    def _progress(self, message: Any) -> None:
        now = message.feedback.progress
        best = best_in_words(metrics_from_message(now.best[0]) if now.best else None)
        self._told(f"{now.phase}, step {now.effort}, {now.elapsed:.1f} s; {best}")
