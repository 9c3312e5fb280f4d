"""The action `plan_trajectory_action`: goals, cancellation and feedback of planning requests."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import TypeAlias

from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import PlanAnswer, PlanMetrics, PlanProgress, PlanRequest
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.watch import Progress
from ff_planner_ros.ros.messages.from_messages import OnCancel
from ff_planner_ros.ros.qos import REQUEST_QOS
from ff_planner_ros.ros.requests.jobs import Job, Jobs
from ff_planner_ros.ros.topics import ACTION

# Returns the answer to a job; takes also what is called with the progress.
Answering: TypeAlias = Callable[[Job, Callable[[Progress], None]], PlanAnswer]

# Who asks for the result of an action later than this [s] gets none.
_RESULT_TIMEOUT = 60
# rclpy tells a goal of its cancellation right after the callback that accepts it [s].
_CANCEL_PATIENCE, _CANCEL_POLL = 1.0, 0.001
# By so much at most [m, rad or rad/s] does a path violate its constraints that is told as found.
_NO_VIOLATION = 1e-6


class PlanAction:
    """The action server: a goal is a request, and its result is the answer.

    Every goal is accepted, because rclpy tells the client of a rejected one nothing else; a goal
    that gets no plan is aborted with its answer.
    """

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        jobs: Jobs,
        arrived: Callable[[PlanRequest], Job],
        answer: Answering,
    ) -> None:
        """Open the action.

        Args:
            jobs: Jobs of the planner, which the action shares with the service.
            arrived: Returns the job of a request that has come.
            answer: Plans, and returns the answer to a job.
        """
        self._jobs, self._arrived, self._answer = jobs, arrived, answer
        self._goals: dict[bytes, Job] = {}  # that are not answered, by their ids
        self._lock = threading.Lock()
        self._server = ActionServer(
            node,
            PlanTrajectory,
            ACTION.name,
            self._execute,
            callback_group=group,
            handle_accepted_callback=self._accept,
            cancel_callback=self._cancel,
            goal_service_qos_profile=REQUEST_QOS,
            result_service_qos_profile=REQUEST_QOS,
            cancel_service_qos_profile=REQUEST_QOS,
            result_timeout=_RESULT_TIMEOUT,
        )

    def destroy(self) -> None:
        """Destroy the action server."""
        self._server.destroy()

    def _accept(self, goal: ServerGoalHandle) -> None:
        """Reserve the planner in the order of arrival, and have the goal executed."""
        with self._lock:
            job = self._job_of(goal)
        self._jobs.admit(job)
        try:
            goal.execute()
        except rclpy_implementation.RCLError:
            # Cancelled between rclpy's look at the goal's state and its change: the second look
            # finds that, and the goal is executed to be told so.
            goal.execute()

    def _cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        with self._lock:
            if not goal.is_active:
                return CancelResponse.REJECT
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

        with self._lock:
            job = self._job_of(goal)
        answer = self._answer(job, tell)
        cancelled = answer.status.code == Status.CANCELLED and _is_cancelling(goal)
        with self._lock:  # from here on it cannot be cancelled
            if answer.status.code == Status.SOLVED:
                goal.succeed()
            elif cancelled:
                goal.canceled()
            else:
                goal.abort()
            del self._goals[bytes(goal.goal_id.uuid)]
        return PlanTrajectory.Result(answer=answer)

    def _job_of(self, goal: ServerGoalHandle) -> Job:
        """Return the job of a goal; its cancellation may come before `_accept` is called."""
        key = bytes(goal.goal_id.uuid)
        if key not in self._goals:
            self._goals[key] = self._arrived(goal.request.request)
        return self._goals[key]


def _is_cancelling(goal: ServerGoalHandle) -> bool:
    """Wait until rclpy has noted the cancellation that its callback accepted."""
    give_up = time.monotonic() + _CANCEL_PATIENCE
    while not goal.is_cancel_requested and time.monotonic() < give_up:
        time.sleep(_CANCEL_POLL)
    return bool(goal.is_cancel_requested)
