"""The solver in processes of its own: planning holds up no callback, and may crash."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle
from queue import Empty, SimpleQueue
from typing import TypeAlias

from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.errors import FfPlannerError, Interrupted, NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Budget, Progress
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.requests import solver_process
from ff_planner_ros.ros.requests.solver_process import Answer

# What a plan's process sends; None: it has ended.
_Message: TypeAlias = Progress | Answer | None

# Period of the check whether a plan is still wanted [s].
_POLL = 0.02
# Loading takes seconds; a server that needs so much longer [s] counts as hanging.
_LOADING = 60.0
# A search that ends in time needs a little longer for its answer on a busy machine: as long as its
# budget, at least and at most [s]. A search given up without an answer cannot be replayed to its
# step. A solver that is loading gets none: there is nothing to wait for.
_LEAST_GRACE, _GRACE = 1.0, 5.0
# A fork takes milliseconds; a loaded server that has begun no plan after so much waiting [s]
# hangs, however busy the machine is.
_BEGINNING = 10.0


class Worker:
    """Makes one plan at a time in a solver process; a spare one replaces it if it dies."""

    def __init__(self) -> None:
        """Start the process; it loads its libraries while the caller goes on."""
        self._servers = [_Server()]  # the first plans
        self._solving = threading.Lock()
        self._interrupted = self._closed = False

    @property
    def is_warm(self) -> bool:
        """Whether the next plan can begin at once; a solver that died while idle is replaced."""
        if self._solving.acquire(blocking=False):
            try:
                self._replace_dead()
            finally:
                self._solving.release()
        return self._servers[0].is_loaded

    def wait_until_warm(self) -> None:
        """Wait until the solver has loaded its libraries.

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

        def still_wanted() -> None:
            check()
            if self._interrupted:
                raise Interrupted
            late = time.monotonic() - begun - budget.seconds
            is_ready = has_begun or self._servers[0].is_loaded
            if late > (max(_LEAST_GRACE, min(budget.seconds, _GRACE)) if is_ready else 0.0):
                raise NoPlanFound(
                    Status.TIMED_OUT,
                    f"the time budget of {budget.seconds:g} s is used up {why()}; whether there is "
                    "a plan is not known",
                )

        def why() -> str:
            if has_begun:
                words = "ask for fewer points or give it more time"
                return f"within a single iteration ({to_begin:.2f} s to begin): {words}"
            if self._servers[0].is_loaded:
                return "before the solver began, which hangs, or whose machine is busy: ask again"
            return (
                f"while a new solver has been loading its libraries for {self._servers[0].age:.2f} "
                "s, because the one before has died: ask again when /diagnostics says that it is "
                "ready, or give it more time"
            )

        request = pickle.dumps((task, budget, begun))
        has_begun, to_begin = False, 0.0
        with self._solving:
            self._interrupted = False
            if self._closed:  # looked at last: `close` sets it first
                raise Interrupted
            with self._begun(request, still_wanted) as process:
                has_begun, to_begin = True, time.monotonic() - begun
                answer = process.answer(still_wanted, report, ends_early)
        try:
            if isinstance(answer, FfPlannerError):
                raise answer
            if isinstance(answer, str):
                raise FfPlannerError(Status.INTERNAL_ERROR, f"the planner failed: {answer}")
            return answer
        finally:
            # The error's traceback holds this frame; a variable in it would hold the error, and
            # both would stay, with the plan that was tried, until a full garbage collection.
            del answer

    def interrupt(self) -> None:
        """End the plan that is being made, if there is one: its `solve` raises Interrupted."""
        self._interrupted = True

    def close(self) -> None:
        """End the plan that is being made and every process; there will be no other."""
        self._closed = True
        self.interrupt()
        with self._solving:
            for server in self._servers:
                server.end()

    @contextmanager
    def _begun(self, request: bytes, still_wanted: Callable[[], None]) -> Iterator[_PlanProcess]:
        """Have the solver begin a plan; each that has died or hangs is replaced, once."""
        replaceable = len(self._servers)
        still_wanted()
        process = self._servers[0].fork(request)
        try:
            while not self._servers[0].has_begun(process):
                still_wanted()
                if self._servers[0].is_lost:
                    code = self._servers[0].end()
                    self._replace_dead()
                    if not replaceable:
                        raise _death(str(code))
                    process.close()
                    process, replaceable = self._servers[0].fork(request), replaceable - 1
            yield process
        finally:
            process.close()

    def _replace_dead(self) -> None:
        """Load a server in the place of one that has died, and a spare once the first is loaded."""
        if self._closed:
            return
        servers = [server for server in self._servers if not server.has_died]
        for server in self._servers:
            if server not in servers:
                server.end()
        if not servers or (len(servers) == 1 and servers[0].is_loaded):
            servers.append(_Server())
        self._servers = servers


def _death(code: str) -> FfPlannerError:
    return FfPlannerError(
        Status.SOLVER_DIED,
        f"the solver process died with exit code {code} (-N: killed by signal N); "
        "a new one takes its place, the request may be sent again",
    )


class _Server:
    """The process that `solver_process.serve` runs in, and its forks."""

    def __init__(self) -> None:
        self._requests, theirs = Pipe()
        with theirs:
            # A session of its own: Ctrl-C in a terminal is for the node; and a group to kill.
            self._process = subprocess.Popen(
                [sys.executable, "-m", solver_process.__name__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env=os.environ | PLANNING,
                start_new_session=True,
            )
        self._started = time.monotonic()
        self._waited = 0.0  # for plans that it has not begun, since it was loaded or began one [s]

    @property
    def is_loaded(self) -> bool:
        """Whether it is ready for plans: its message that it has loaded stays unread for that."""
        with suppress(OSError):  # ended meanwhile
            return not self.has_died and self._requests.poll()
        return False

    @property
    def age(self) -> float:
        """Time since its start [s]."""
        return time.monotonic() - self._started

    @property
    def has_died(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    @property
    def is_lost(self) -> bool:
        """Whether it has died, or hangs: it was waited for too long."""
        if self.is_loaded:
            return self._waited > _BEGINNING
        return self.has_died or time.monotonic() > self._started + _LOADING

    def fork(self, request: bytes) -> _PlanProcess:
        """Have it begin a plan in a process of its own."""
        control, its_control = Pipe()
        data, its_data = Pipe()
        with its_control, its_data, suppress(OSError):  # it has died, which `is_lost` tells
            for one in (its_control, its_data):
                send_handle(self._requests, one.fileno(), self._process.pid)
        return _PlanProcess(control, data, request)

    def has_begun(self, process: _PlanProcess) -> bool:
        """Wait a moment for the begin of a plan; return whether it has begun."""
        before, is_loaded = time.monotonic(), self.is_loaded
        begun = process.has_begun()
        hangs = is_loaded and not begun
        self._waited = self._waited + time.monotonic() - before if hangs else 0.0
        return begun

    def end(self) -> int:
        """End it, a plan that is being made included, and return its exit code."""
        if not self._requests.closed:
            self._requests.close()
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        return self._process.wait()


class _PlanProcess:
    """The process that makes a plan; closed before its answer, it ends."""

    def __init__(self, control: Connection, data: Connection, request: bytes) -> None:
        self._control, self._data = control, data
        self._sent, self._received = threading.Event(), SimpleQueue[_Message]()
        # A process may stop in the midst of a long message: a thread waits for it.
        arguments = data, request, self._sent, self._received
        threading.Thread(target=_converse, args=arguments, daemon=True).start()

    def has_begun(self) -> bool:
        """Wait a moment for the server's message that the plan is begun; return whether it came."""
        with suppress(EOFError, OSError):  # the server has died
            return self._control.poll(_POLL) and self._control.recv() is None
        return False

    def answer(
        self,
        still_wanted: Callable[[], None],
        report: Callable[[Progress], None],
        ends_early: Callable[[], bool],
    ) -> Answer:
        """Return the answer of the process.

        Raises:
            FfPlannerError: The process died before its answer (SOLVER_DIED).
        """
        is_told = False
        while True:
            still_wanted()
            if not is_told and self._sent.is_set() and ends_early():
                is_told = True
                with suppress(OSError):  # it has ended
                    self._data.send(None)
            try:
                message = self._received.get(timeout=_POLL)
            except Empty:
                continue
            if message is None:
                raise _death(self._exit_code(still_wanted))
            if not isinstance(message, Progress):
                if not isinstance(message, str):  # after that nobody knows what state it is in
                    with suppress(OSError):  # its server has died
                        self._control.send(None)  # it may make the next plan
                return message
            report(message)

    def close(self) -> None:
        """Let go of it: its server ends it, or keeps it for the next plan after an answer."""
        self._control.close()

    def _exit_code(self, still_wanted: Callable[[], None]) -> str:
        while not self._control.poll(_POLL):
            still_wanted()
        try:
            return str(self._control.recv())
        except (EOFError, OSError):  # nobody is left to say it
            return "unknown"


def _converse(
    data: Connection, request: bytes, sent: threading.Event, received: SimpleQueue[_Message]
) -> None:
    """Send a request, and pass on what comes back until the other side ends."""
    try:
        with data, suppress(EOFError, OSError):
            data.send_bytes(request)
            sent.set()  # from now on others may send
            while True:
                received.put(data.recv())
    finally:
        received.put(None)
