"""Requests, from the door to their answers: one is planned at a time, and any may be given up."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ff_planner_ros.errors import FfPlannerError, Status


class Job:
    """A request until it is answered."""

    def __init__(self, plan_id: str, number: int) -> None:
        """Begin with nothing against it."""
        self.plan_id, self.number = plan_id, number  # a later request has a higher number
        self._lock = threading.Lock()
        self._cause: FfPlannerError | None = None
        self._sealed = False
        # Whether the best plan until now shall be its answer
        self.ends_early = False

    @property
    def cause(self) -> FfPlannerError | None:
        """Why it was given up; None if it was not."""
        with self._lock:
            return self._cause

    def give_up(self, cause: FfPlannerError) -> bool:
        """Answer it with a cause instead of a plan; False if its answer stands already."""
        with self._lock:
            if self._sealed:
                return False
            self._cause = self._cause or cause
            return True

    def end_early(self) -> bool:
        """Answer it with the best plan until now; False if its answer stands already."""
        with self._lock:
            self.ends_early = not self._sealed
            return self.ends_early

    def check(self) -> None:
        """Raise the cause for which it was given up, if it was.

        Raises:
            FfPlannerError: The cause.
        """
        if self.cause is not None:
            raise self.cause

    def seal(self) -> None:
        """Let its plan be its answer: from now on it cannot be given up.

        Raises:
            FfPlannerError: The cause for which it was given up before.
        """
        with self._lock:
            if self._cause is not None:
                raise self._cause
            self._sealed = True


class Jobs:
    """Who is planned for now, and who may be."""

    def __init__(self, interrupt: Callable[[], None]) -> None:
        """Begin closed; `interrupt` ends the plan that is being made, if one is."""
        self._interrupt = interrupt
        self._change = threading.Condition()
        self._current: Job | None = None
        self._waiting: Job | None = None
        self._admitted: Job | None = None  # taken up next, and nobody else before
        self._refusal: FfPlannerError | None = None
        self.close(Status.NOT_ACTIVE, "the planner is not active yet")

    @property
    def is_open(self) -> bool:
        """Whether requests are taken up."""
        return self._refusal is None

    def open(self) -> None:
        """Take up requests from now on."""
        with self._change:
            self._refusal = None

    def close(self, status: Status, message: str) -> None:
        """Take up no more requests, and answer those that are taken up with this status."""
        with self._change:
            self._refusal = FfPlannerError(status, message)
        self.give_up_all(status, message)

    def give_up_all(self, status: Status, message: str) -> None:
        """Give up whatever is being planned."""
        with self._change:
            for job in self._all():
                self.give_up(job, FfPlannerError(status, message))

    def give_up(self, job: Job, cause: FfPlannerError) -> bool:
        """Give up one job; False if its answer stands already."""
        given_up = job.give_up(cause)
        with self._change:
            if given_up and job is self._current:
                self._interrupt()
            self._change.notify_all()
        return given_up

    def wait_until_idle(self, patience: float) -> None:
        """Wait until nobody is planned for, at most for a time [s]."""
        with self._change:
            self._change.wait_for(lambda: not self._all(), patience)

    def admit(self, job: Job, *, preempt: bool) -> None:
        """Promise a job that it is taken up; `withdraw` it if it never comes to that.

        Raises:
            FfPlannerError: Why it would not be taken up (NOT_ACTIVE, SHUT_DOWN, BUSY).
        """
        with self._change:
            self._require_room(preempt)
            if not preempt:
                self._admitted = job

    def withdraw(self, job: Job) -> None:
        """Make room again for others than a job that was admitted."""
        with self._change:
            if job is self._admitted:
                self._admitted = None
                self._change.notify_all()

    @contextmanager
    def taken_up(self, job: Job, *, preempt: bool) -> Iterator[None]:
        """Plan for a job and for nobody else; it is refused, or it may preempt another one.

        Raises:
            FfPlannerError: Why it is not taken up (NOT_ACTIVE, SHUT_DOWN, BUSY), or was given up
                while it waited for the other one to make room.
        """
        with self._change:
            try:
                self._make_way(job, preempt)
                self._current = job
            finally:
                self.withdraw(job)
        try:
            yield
        finally:
            with self._change:
                self._current = None
                self._change.notify_all()

    def _all(self) -> list[Job]:
        """Return all who are planned for, or will be."""
        held = (self._current, self._waiting, self._admitted)
        return [job for job in held if job is not None]

    def _require_room(self, preempt: bool) -> None:
        if self._refusal is not None:
            raise FfPlannerError(self._refusal.status, str(self._refusal))
        if self._all() and not preempt:
            raise FfPlannerError(
                Status.BUSY,
                "another request is being planned: ask again when it is answered, or cancel it "
                "(or set the parameter when_busy to preempt)",
            )

    def _make_way(self, job: Job, preempt: bool) -> None:
        job.check()
        others = [other for other in self._all() if other is not job]
        self._require_room(preempt or job is self._admitted)
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
