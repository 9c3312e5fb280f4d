"""The action `plan_trajectory_action`: goals, cancellation and feedback of planning requests."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, TypeAlias

from action_msgs.msg import GoalStatus
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import PlanAnswer, PlanMetrics, PlanProgress, PlanRequest
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.watch import Progress
from ff_planner_ros.ros.messages.from_messages import OnCancel
from ff_planner_ros.ros.messages.interfaces import ACTION, GET_RESULT, SEND_GOAL
from ff_planner_ros.ros.qos import EVENT_QOS, REQUEST_QOS
from ff_planner_ros.ros.requests.action_events import ActionEvents
from ff_planner_ros.ros.requests.jobs import Job, Jobs

# Returns the answer to a request; takes also the interface it came by, its job, and a callback.
Answering: TypeAlias = Callable[[PlanRequest, str, Job, Callable[[Progress], None]], PlanAnswer]

# Who asks for the result of an action later than this [s] gets none.
_RESULT_TIMEOUT = 60
# rclpy tells a goal of its cancellation right after the callback that accepts it [s].
_CANCEL_PATIENCE, _CANCEL_POLL = 1.0, 0.001
# By so much at most [m, rad or rad/s] does a path violate its constraints that is told as found.
_NO_VIOLATION = 1e-6


class PlanAction:
    """The action server: a goal is a request, and its result is the answer."""

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        jobs: Jobs,
        new_job: Callable[[], Job],
        preempts: Callable[[], bool],
        answer: Answering,
        refuse: Callable[[Job, FfPlannerError], PlanAnswer],
    ) -> None:
        """Open the action.

        Args:
            jobs: Jobs of the planner, which the action shares with the service.
            new_job: Returns the job of a new goal.
            preempts: Returns whether a goal takes the place of the current request.
            answer: Plans, and returns the answer to a request.
            refuse: Returns the answer to a job that is not accepted, and logs it.
        """
        self._jobs, self._new_job, self._preempts = jobs, new_job, preempts
        self._answer, self._refuse = answer, refuse
        self._goals: dict[bytes, Job] = {}
        self._admitted = set[int]()  # what is asked, by its address, until it is handed over
        self._lock = threading.Lock()
        self._server = _Server(
            self._arrive,
            self._depart,
            node,
            PlanTrajectory,
            ACTION,
            self._execute,
            callback_group=group,
            goal_callback=self._decide,
            handle_accepted_callback=self._accept,
            cancel_callback=self._cancel,
            goal_service_qos_profile=REQUEST_QOS,
            result_service_qos_profile=REQUEST_QOS,
            cancel_service_qos_profile=REQUEST_QOS,
            result_timeout=_RESULT_TIMEOUT,
        )
        self._events = ActionEvents(node, ACTION, EVENT_QOS)

    def destroy(self) -> None:
        """Destroy the action server."""
        self._server.destroy()
        self._events.destroy()

    def _arrive(self, asked: SEND_GOAL.Request) -> None:
        """Admit a goal or publish why not; an error in its request becomes its result, later."""
        key = bytes(asked.goal_id.uuid)
        with self._lock:
            if key in self._goals:
                return  # the id of another goal: rclpy refuses it
            job = self._goals[key] = self._new_job()
        self._events.goal_received(asked)
        try:
            self._jobs.admit(job, preempt=self._preempts())
        except FfPlannerError as cause:
            self._forget(key)
            result = GET_RESULT.Request(goal_id=asked.goal_id)
            answer = self._refuse(job, cause)
            self._events.result_sent(result, GoalStatus.STATUS_UNKNOWN, answer)
        else:
            self._admitted.add(id(asked.goal))

    def _decide(self, goal: PlanTrajectory.Goal) -> GoalResponse:
        return GoalResponse.ACCEPT if id(goal) in self._admitted else GoalResponse.REJECT

    def _depart(self, asked: SEND_GOAL.Request) -> None:
        """Withdraw an admitted goal that rclpy did not hand over because its client is gone."""
        if id(asked.goal) in self._admitted:
            self._admitted.discard(id(asked.goal))
            key = bytes(asked.goal_id.uuid)
            self._jobs.withdraw(self._goals[key])
            self._forget(key)

    def _accept(self, goal: ServerGoalHandle) -> None:
        self._admitted.discard(id(goal.request))
        try:
            goal.execute()
        except rclpy_implementation.RCLError:
            # Cancelled between rclpy's look at the goal's state and its change: the second look
            # finds that, and the goal is executed to be told so.
            goal.execute()

    def _cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        job = self._job_of(goal)
        if goal.request.request.on_cancel == OnCancel.BEST:
            accepted = job.end_early()
        else:
            cause = FfPlannerError(Status.CANCELLED, "the client of the action cancelled it")
            accepted = self._jobs.give_up(job, cause)
        return CancelResponse.ACCEPT if accepted else CancelResponse.REJECT

    def _execute(self, goal: ServerGoalHandle) -> PlanTrajectory.Result:
        begun, best = time.perf_counter(), math.inf

        def tell(progress: Progress) -> None:
            nonlocal best
            if progress.violation <= _NO_VIOLATION:
                best = min(best, progress.objective)
            found = math.isfinite(best)
            told = PlanProgress(
                phase=progress.phase,
                effort=progress.step,
                elapsed=time.perf_counter() - begun,
                found=found,
                best_objective=best if found else math.nan,
                best=[] if progress.best is None else [PlanMetrics(**asdict(progress.best))],
            )
            goal.publish_feedback(PlanTrajectory.Feedback(progress=told))

        answer = self._answer(goal.request.request, ACTION, self._job_of(goal), tell)
        if answer.status.code == Status.SOLVED:
            goal.succeed()
        elif answer.status.code == Status.CANCELLED and _is_cancelling(goal):
            goal.canceled()
        else:
            goal.abort()
        self._forget(bytes(goal.goal_id.uuid))  # it cannot be cancelled any more
        asked = GET_RESULT.Request(goal_id=goal.goal_id)
        self._events.result_sent(asked, goal.status, answer)
        return PlanTrajectory.Result(answer=answer)

    def _job_of(self, goal: ServerGoalHandle) -> Job:
        with self._lock:
            return self._goals[bytes(goal.goal_id.uuid)]

    def _forget(self, key: bytes) -> None:
        with self._lock:
            del self._goals[key]


class _Server(ActionServer):
    """Passes on each goal with its id, which rclpy does not pass to the goal callback."""

    def __init__(
        self,
        arrive: Callable[[SEND_GOAL.Request], None],
        depart: Callable[[SEND_GOAL.Request], None],
        *server: Any,
        **options: Any,
    ) -> None:
        """Open the server; `arrive` is called before the goal callback, `depart` at the end."""
        self._arrive, self._depart = arrive, depart
        ActionServer.__init__(self, *server, **options)

    async def execute(self, taken_data: dict[str, Any]) -> None:
        if "goal" not in taken_data:
            await ActionServer.execute(self, taken_data)
            return
        _, asked = taken_data["goal"]
        self._arrive(asked)
        try:
            await ActionServer.execute(self, taken_data)
        finally:
            self._depart(asked)


def _is_cancelling(goal: ServerGoalHandle) -> bool:
    """Wait until rclpy has noted the cancellation that its callback accepted."""
    give_up = time.monotonic() + _CANCEL_PATIENCE
    while not goal.is_cancel_requested and time.monotonic() < give_up:
        time.sleep(_CANCEL_POLL)
    return bool(goal.is_cancel_requested)
