"""Requests from arrival to answer: one is planned at a time, and any may be given up."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ff_planner_msgs.msg import PlanRequest

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.exchange_words import Interface


class Job:
    """A request until it is answered."""

    def __init__(
        self, plan_id: str, number: int, request: PlanRequest, interface: Interface, requester: str
    ) -> None:
        """Create a job that is not given up; a later request has a higher number."""
        self.plan_id, self.number, self.request = plan_id, number, request
        self.interface, self.requester = interface, requester
        self._lock = threading.Lock()
        self._cause: FfPlannerError | None = None
        self._sealed = False
        # Whether the best plan found until now becomes the answer
        self.ends_early = False

    @property
    def cause(self) -> FfPlannerError | None:
        """Why the job was given up; None if it was not."""
        with self._lock:
            return self._cause

    def give_up(self, cause: FfPlannerError) -> bool:
        """Let the answer be a cause instead of a plan; return False if the job is sealed."""
        with self._lock:
            if self._sealed:
                return False
            self._cause = self._cause or cause
            return True

    def end_early(self) -> bool:
        """Let the answer be the best plan until now; return False if the job is sealed."""
        with self._lock:
            self.ends_early = not self._sealed
            return self.ends_early

    def check(self) -> None:
        """Raise the cause if the job was given up.

        Raises:
            FfPlannerError: The cause.
        """
        cause = self.cause
        if cause is not None:
            raise FfPlannerError(cause.status, str(cause))  # whose traceback holds the job

    def seal(self) -> None:
        """Fix the job's plan as its answer: from now on the job cannot be given up.

        Raises:
            FfPlannerError: The cause, if the job was given up before.
        """
        with self._lock:
            if self._cause is None:
                self._sealed = True
        self.check()


class Jobs:
    """The job that is planned now, and those that may follow."""

    def __init__(self, interrupt: Callable[[], None], *, preempt: bool) -> None:
        """Begin closed.

        Args:
            interrupt: Ends the current search, if there is one.
            preempt: Whether a job takes the place of those before it.
        """
        self._interrupt, self._preempt = interrupt, preempt
        self._change = threading.Condition()
        self._current: Job | None = None
        self._waiting: Job | None = None
        self._admitted: Job | None = None  # taken up next, and nobody else before
        self._refusal: FfPlannerError | None = None
        self.close(Status.NOT_ACTIVE, "the planner is not active yet")

    @property
    def is_open(self) -> bool:
        """Whether jobs are accepted."""
        return self._refusal is None

    def open(self) -> None:
        """Accept jobs from now on."""
        with self._change:
            self._refusal = None

    def close(self, status: Status, message: str) -> None:
        """Refuse new jobs and give up the current ones, both with this status and message."""
        with self._change:
            self._refusal = FfPlannerError(status, message)
        self.give_up_all(status, message)

    def give_up_all(self, status: Status, message: str) -> None:
        """Give up every job, planned or waiting."""
        with self._change:
            for job in self._all():
                self.give_up(job, FfPlannerError(status, message))

    def give_up(self, job: Job, cause: FfPlannerError) -> bool:
        """Give up one job; return False if it is sealed."""
        given_up = job.give_up(cause)
        with self._change:
            if given_up and job is self._current:
                self._interrupt()
            self._change.notify_all()
        return given_up

    def wait_until_idle(self, patience: float) -> None:
        """Wait until there are no jobs, at most `patience` seconds."""
        with self._change:
            self._change.wait_for(lambda: not self._all(), patience)

    def admit(self, job: Job) -> None:
        """Reserve the planner for a job until it is taken up, unless jobs preempt.

        If the planner is closed (NOT_ACTIVE, SHUT_DOWN), or has a job and none preempts (BUSY),
        this job is given up.
        """
        with self._change:
            self._give_up_without_room(job)
            if job.cause is None and not self._preempt:
                self._admitted = job

    @contextmanager
    def taken_up(self, job: Job) -> Iterator[None]:
        """Plan only this job while the context lasts; if jobs preempt, those before are given up.

        Raises:
            FfPlannerError: The planner is closed (NOT_ACTIVE, SHUT_DOWN), has a job and none
                preempts (BUSY), has a newer job (PREEMPTED), or this one was given up.
        """
        with self._change:
            try:
                self._make_way(job)
                self._current = job
            finally:
                if job is self._admitted:
                    self._admitted = None
                    self._change.notify_all()
        try:
            yield
        finally:
            with self._change:
                self._current = None
                self._change.notify_all()

    def _all(self) -> list[Job]:
        """Return all jobs, planned or waiting."""
        held = (self._current, self._waiting, self._admitted)
        return [job for job in held if job is not None]

    def _give_up_without_room(self, job: Job) -> None:
        if self._refusal is not None:
            job.give_up(self._refusal)
        elif self._all() and not self._preempt and job is not self._admitted:
            words = (
                "another request is being planned: ask again when it is answered, or cancel it "
                "(or set the parameter when_busy to preempt)"
            )
            job.give_up(FfPlannerError(Status.BUSY, words))

    def _make_way(self, job: Job) -> None:
        self._give_up_without_room(job)
        job.check()
        others = [other for other in self._all() if other is not job]
        if not others:
            return
        # Requests are taken up in threads, and not always in the order in which they came.
        newest = max((job, *others), key=lambda one: one.number)
        preempted = FfPlannerError(
            Status.PREEMPTED, f"the newer request {newest.plan_id} took its place"
        )
        if newest is not job:
            raise preempted
        for other in others:
            self.give_up(other, preempted)
        self._waiting = job
        try:
            while self._current is not None:
                job.check()
                self._change.wait()
            job.check()
        finally:
            if self._waiting is job:
                self._waiting = None
