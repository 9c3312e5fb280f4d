"""The solver in processes of its own: planning holds up no callback, and may crash."""

from __future__ import annotations

import io
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from queue import Empty, SimpleQueue
from typing import Any

from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.errors import FfPlannerError, Interrupted, NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Budget, Progress
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.requests.solver_process import CANCEL, WORN, Answer, robot_from, serve

_MAIN = f"from {serve.__module__} import main; main()"
# Period of the check whether a plan is still wanted [s].
_POLL = 0.02
# Loading takes seconds, and clearing up less; a process that needs so much longer [s] hangs.
_LOADING = 60.0
# A process whose plan is not wanted any more has so long to be ready again [s].
_SILENCE = 1.0
# A search that ends in time needs a little longer for its answer on a busy machine: as long as its
# budget, at least and at most [s]. A search given up without an answer cannot be replayed to its
# step.
_LEAST_GRACE, _GRACE = 1.0, 5.0


class Solver:
    """Has one plan at a time made by one of two equal processes: the first that is ready."""

    def __init__(self) -> None:
        """Start a process, which loads its libraries while the caller goes on; the other later."""
        self._children = [_Child()]
        self._solving, self._tending = threading.Lock(), threading.RLock()
        self._interrupted = self._closed = False

    @property
    def is_warm(self) -> bool:
        """Whether the next plan can begin at once; a process that died is replaced."""
        return any(child.is_loaded and not child.is_lost for child in self._tended())

    def wait_until_warm(self) -> None:
        """Wait until a process has loaded its libraries.

        Raises:
            FfPlannerError: It has not within a minute (SOLVER_DIED).
        """
        give_up = time.monotonic() + _LOADING
        while not self.is_warm:
            if time.monotonic() > give_up:
                raise FfPlannerError(
                    Status.SOLVER_DIED,
                    f"the solver process has not loaded its libraries within {_LOADING:g} s; what "
                    "it says itself is on the node's stderr",
                )
            time.sleep(_POLL)

    def solve(
        self,
        task: PlanningTask,
        budget: Budget,
        begun: float,
        check: Callable[[], None],
        report: Callable[[Progress], None],
        ends_early: Callable[[], bool] = lambda: False,
    ) -> Plan:
        """Plan in another process and wait for the answer.

        Args:
            budget: Wall-clock time that the search may take.
            begun: When the budget began to run, by the monotonic clock [s].
            check: Called before the search and many times a second until its answer; what it raises
                ends the search.
            report: Called now and then with the progress; what it raises ends the search.
            ends_early: Called many times a second; if True, the best plan until then is the answer.

        Raises:
            Interrupted: By `close`, or by `interrupt` from the first call of `check` on.
            FfPlannerError: What the planner raised; or the budget was used up before it answered
                (TIMED_OUT), the process died (SOLVER_DIED) or failed in a way that the planner
                does not foresee (INTERNAL_ERROR).
        """

        def still_wanted(grace: float, why: str) -> None:
            check()
            if self._interrupted:
                raise Interrupted
            if time.monotonic() > begun + budget.seconds + grace:
                raise NoPlanFound(
                    Status.TIMED_OUT,
                    f"the time budget of {budget.seconds:g} s is used up {why}, or give it more "
                    "time; whether there is a plan is not known",
                )

        request = _request(task, budget, begun)
        grace = max(_LEAST_GRACE, min(budget.seconds, _GRACE))
        with self._solving:
            self._interrupted = False
            if self._closed:  # looked at last: `close` sets it first
                raise Interrupted
            still_wanted(grace, "before the search began: ask again")
            while (child := self._begun(request)) is None:
                still_wanted(
                    0.0,  # there is no answer to wait for
                    "while no solver was ready, since a new one loads its libraries in the place "
                    "of one that died or hung: ask again when /diagnostics says that it is ready",
                )
                time.sleep(_POLL)
            answer = child.answer(
                lambda: still_wanted(grace, "within a single iteration: ask for fewer points"),
                report,
                ends_early,
            )
        try:
            if isinstance(answer, FfPlannerError):
                raise answer
            return answer
        finally:
            # The error's traceback holds this frame; a variable in it would hold the error, and
            # both would stay, with the plan that was tried, until a full garbage collection.
            del answer

    def interrupt(self) -> None:
        """End the plan that is being made, if there is one: its `solve` raises Interrupted."""
        self._interrupted = True

    def close(self) -> None:
        """End the plan that is being made and both processes; there will be no other."""
        self._closed = True
        self.interrupt()
        with self._solving, self._tending:
            for child in self._children:
                child.end()

    def _begun(self, request: bytes) -> _Child | None:
        """Have the first process that is ready begin a plan; None: none is ready."""
        with self._tending:
            for child in self._tended():
                if child.is_ready and not child.is_lost:
                    child.begin(request)
                    return child
        return None

    def _tended(self) -> list[_Child]:
        """Replace processes that are of no more use, and return all.

        The second one is started when the first has loaded. One that has made its share of plans
        ends when both are ready: the other takes its place.
        """
        with self._tending:
            if self._closed:
                return []
            children = self._children
            ended = [child for child in children if child.is_lost]
            if len(children) > 1 and all(child.is_ready for child in children):
                ended = ended or [child for child in children if child.is_worn][:1]
            for child in ended:
                child.end()
                children.remove(child)
            if len(children) < 2 and all(child.is_loaded for child in children):
                children.append(_Child())
            return children


class _Child:
    """A process that `solver_process.serve` runs in; no call but `end` waits for it."""

    def __init__(self) -> None:
        self._link, theirs = Pipe()
        with theirs:
            # A session of its own: Ctrl-C in a terminal is for the node; and a group to kill.
            self._process = subprocess.Popen(
                [sys.executable, "-c", _MAIN, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env=os.environ | PLANNING,
                start_new_session=True,
            )
        self.is_loaded = self.is_ready = self.is_worn = self._has_ended = False
        self._ready_by = time.monotonic() + _LOADING
        self._to_send = SimpleQueue[bytes | None]()
        self._received = SimpleQueue[Progress | Answer]()
        # A process may stop in the midst of a long message: threads wait for it.
        for work in (self._send, self._receive):
            threading.Thread(target=work, daemon=True).start()

    @property
    def is_lost(self) -> bool:
        """Whether it has died, or hangs."""
        return self._has_ended or (not self.is_ready and time.monotonic() > self._ready_by)

    def begin(self, request: bytes) -> None:
        """Have it make a plan."""
        self._ready_by, self.is_ready = math.inf, False
        self._received = SimpleQueue()  # without what the plan before has left
        self._to_send.put(request)

    def answer(
        self,
        still_wanted: Callable[[], None],
        report: Callable[[Progress], None],
        ends_early: Callable[[], bool],
    ) -> Answer:
        """Wait for the answer, unless `still_wanted` or `report` raises.

        Raises:
            FfPlannerError: The process died before its answer (SOLVER_DIED).
        """
        is_cancelled = False
        try:
            while True:
                still_wanted()
                if not is_cancelled and ends_early():
                    is_cancelled = True
                    self._to_send.put(pickle.dumps(CANCEL))
                message = self._next_message()
                if isinstance(message, Progress):
                    report(message)
                elif message is not None:
                    self._ready_by = time.monotonic() + _LOADING
                    return message
        except BaseException:
            self._to_send.put(pickle.dumps(CANCEL))
            self._ready_by = time.monotonic() + _SILENCE
            raise

    def _next_message(self) -> Progress | Answer | None:
        """Wait a moment for a message; return None if none has come."""
        has_ended = self._has_ended  # looked at first: nothing comes after that
        try:
            return self._received.get(timeout=_POLL)
        except Empty:
            if not has_ended:
                return None
        raise FfPlannerError(
            Status.SOLVER_DIED,
            f"the solver process died with exit code {self.end()} (-N: killed by signal N); "
            "another takes its place, the request may be sent again",
        )

    def end(self) -> int:
        """End it, a plan that is being made included, and return its exit code."""
        self._to_send.put(None)
        with suppress(subprocess.TimeoutExpired):  # one that ends has an exit code of its own
            return self._process.wait(_SILENCE if self._has_ended else 0.0)
        os.killpg(self._process.pid, signal.SIGKILL)
        return self._process.wait()

    def _send(self) -> None:
        with suppress(OSError):  # it has died
            while (message := self._to_send.get()) is not None:
                self._link.send_bytes(message)

    def _receive(self) -> None:
        try:
            while True:
                message = self._link.recv()
                if isinstance(message, str):
                    self.is_worn = message == WORN
                    self.is_loaded = self.is_ready = True
                else:
                    self._received.put(message)
        except (EOFError, OSError):
            pass
        finally:
            self._has_ended = True


class _RequestPickler(pickle.Pickler):
    """Has a process build a robot only once, with all that is computed of it."""

    def reducer_override(self, one: object) -> Any:
        return (robot_from, (_robot(one),)) if isinstance(one, Robot) else NotImplemented


def _request(task: PlanningTask, budget: Budget, begun: float) -> bytes:
    request = io.BytesIO()
    _RequestPickler(request).dump((task, budget, begun))
    return request.getvalue()


@kept_with_it
def _robot(robot: Robot) -> bytes:
    return pickle.dumps(robot)
