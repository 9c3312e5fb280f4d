"""Requests to a running node: the console's through the action, others' from its exchanges."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future

from ff_planner_msgs.msg import Exchange, PlanAnswer, PlanProgress, PlanRequest

from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.live.link import REQUESTER, Link
from ff_planner_ros.console.live.plans import Plans
from ff_planner_ros.console.search import best_in_words
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.plans import metrics_from_message
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.messages.requests import request_of_task
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.topics import EXCHANGES

_PATIENCE = 2.0  # for the exchange of an answer, which has the task [s]


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
        heard: Callable[[Exchange], None],
    ) -> None:
        """Subscribe to the exchanges of the planner.

        Args:
            start_ns: Returns the start time for a plan that is requested now [ns]; zero: as soon as
                the node can.
            heard: Called with each exchange of other clients that has an answer.
        """
        self._link, self._plans, self._start_ns, self._heard = link, plans, start_ns, heard
        self._own = list[tuple[PlanRequest, Future[Exchange]]]()  # whose exchanges have not come
        link.client.hear(EXCHANGES, self._exchanged, from_now_on=True)

    def __call__(
        self, task: PlanningTask, told: Callable[[str], None], done: Callable[[Entry], None]
    ) -> Asked:
        """Request a plan; see `console.entries.Begin`."""
        request = request_of(task, self._link.parameters.inertial_frame, self._start_ns())
        exchanged = Future[Exchange]()
        self._own.append((request, exchanged))

        def answered(answer: PlanAnswer) -> None:
            try:
                exchange = exchanged.result(_PATIENCE)
            except TimeoutError:
                exchange = Exchange(request=[request], answer=[answer])
            done(self._plans.answered(exchange, task))

        def failed(error: FfPlannerError) -> None:
            status = f"refused, {error.status.name}"
            done(Entry("not planned", task, error=error, status=status, words=str(error)))

        return Asked(self._link, request, told, answered, failed)

    def _exchanged(self, exchange: Exchange) -> None:
        if not (exchange.request and exchange.answer):
            return
        for own in self._own:
            request, exchanged = own
            if request == exchange.request[0]:
                self._own.remove(own)
                exchanged.set_result(exchange)
                return
        self._heard(exchange)


class Asked:
    """A request of the console to the node, which is sent at once."""

    def __init__(
        self,
        link: Link,
        request: PlanRequest,
        told: Callable[[str], None],
        answered: Callable[[PlanAnswer], None],
        failed: Callable[[FfPlannerError], None],
    ) -> None:
        """Send the request.

        Args:
            told: Called with the progress in words.
            answered: Called once, with the answer.
            failed: Called once instead, with the reason why there is no answer.
        """
        self._link, self._request, self._told = link, request, told
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
        planning = self._link.client.ask(self._request, self._progress)

        def look() -> None:
            if lost := self._link.lost:
                raise FfPlannerError(Status.SHUT_DOWN, lost)
            if self._cancelled.is_set():
                self._cancelled.clear()
                planning.cancel()

        return planning.answer(look)

    def _progress(self, now: PlanProgress) -> None:
        best = best_in_words(metrics_from_message(now.best[0]) if now.best else None)
        self._told(f"{now.phase}, step {now.effort}, {now.elapsed:.1f} s; {best}")
