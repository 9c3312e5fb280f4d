"""The solver in processes of its own: planning never holds up a callback, and may even crash."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress

from ff_planner_ros.common.one_thread import ONE_THREAD
from ff_planner_ros.errors import FfPlannerError, Interrupted, NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Progress
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.requests import solver_process
from ff_planner_ros.ros.requests.lines import POLL, Lines
from ff_planner_ros.ros.requests.solver_process import (
    BEGUN,
    LOADED,
    PLAN,
    PROGRESS,
)

# Loading takes seconds; a server that needs so much longer [s] will not get there.
_LOADING = 60.0
# A fork takes milliseconds; a loaded server that has begun no plan after so much waiting [s]
# hangs, however busy the machine is.
_BEGINNING = 10.0
# No packet is longer [bytes].
_PACKET = 4096


class Worker:
    """One solver, replaced when it dies. One plan at a time."""

    def __init__(self) -> None:
        """Start the process; it loads its libraries while the caller goes on."""
        self._server = _Server()
        self._solving, self._lock = threading.Lock(), threading.Lock()
        self._lines: Lines | None = None
        self._interrupted = self._closed = False

    @property
    def is_warm(self) -> bool:
        """Whether the next plan can begin at once; a solver that died while idle is replaced."""
        if self._solving.acquire(blocking=False):
            try:
                if self._server.has_died:
                    self._replace_server()
            finally:
                self._solving.release()
        return self._server.is_loaded

    def wait_until_warm(self) -> None:
        """Wait until the solver has loaded its libraries.

        Raises:
            FfPlannerError: It has not (SOLVER_DIED).
        """
        give_up = time.monotonic() + _LOADING
        while not self.is_warm:
            if time.monotonic() > give_up:
                raise FfPlannerError(
                    Status.SOLVER_DIED,
                    f"the solver process has not loaded its libraries within {_LOADING:g} s; what "
                    "it says itself is on the node's stderr",
                )
            time.sleep(POLL)

    def solve(
        self,
        task: PlanningTask,
        budget: float,
        begun: float,
        check: Callable[[], None],
        report: Callable[[Progress], None],
    ) -> Plan:
        """Plan in another process and wait for the answer.

        Args:
            budget: Wall clock that it may take [s].
            begun: When the budget began to run, of the monotonic clock [s].
            check: Called before it begins and many times a second until it answers; what it raises
                ends the plan.
            report: Told now and then how far the search has come; what it raises ends the plan.

        Raises:
            Interrupted: By `interrupt`, which is heard from before `check` on, or `close`.
            FfPlannerError: What the planner raised; or the budget was used up before it answered
                (TIMED_OUT), the process died (SOLVER_DIED) or failed in a way that the planner
                does not foresee (INTERNAL_ERROR).
        """

        def still_wanted() -> None:
            check()
            if time.monotonic() > begun + budget:
                raise NoPlanFound(
                    Status.TIMED_OUT,
                    f"the time budget of {budget:g} s is used up within a single iteration; "
                    "whether there is a plan is not known: ask for fewer points or give it more "
                    "time",
                )

        with self._solving, closing(Lines(pickle.dumps((task, budget, begun)))) as lines:
            with self._lock:
                if self._closed:
                    raise Interrupted
                self._interrupted, self._lines = False, lines
            try:
                self._begin(lines, still_wanted)
                answer = self._answer(lines, still_wanted, report)
            finally:
                with self._lock:
                    self._lines = None
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
        with self._lock:
            if self._lines is not None:
                self._interrupted = True
                self._lines.hang_up()

    def close(self) -> None:
        """End the plan that is being made and every process; there will be no other."""
        with self._lock:
            self._closed = True
        self.interrupt()
        with self._solving:
            self._server.end()

    def _begin(self, lines: Lines, still_wanted: Callable[[], None]) -> None:
        """Have the solver begin a plan; one that has died or hangs is replaced, once."""
        replaced = False
        still_wanted()
        self._server.begin(lines)
        while not self._server.has_begun(lines):
            still_wanted()
            if self._server.is_lost:
                code = self._replace_server()
                if replaced:
                    raise _death(str(code))
                replaced = True
                self._server.begin(lines)
        lines.leave_theirs()

    def _answer(
        self, lines: Lines, still_wanted: Callable[[], None], report: Callable[[Progress], None]
    ) -> Plan | FfPlannerError | str:
        """Return what the solver process answers; who leaves before ends it by hanging up."""
        code = ""
        while True:
            still_wanted()
            if lines.exchange():
                packet = lines.packets.recv(_PACKET)
                if self._interrupted:
                    raise Interrupted
                if packet[:1] == PROGRESS:
                    report(pickle.loads(packet[1:]))
                elif packet[:1] != BEGUN:  # ENDED, or nobody is left to say so
                    code = code or packet[1:].decode() or "unknown"
            if not lines.is_complete:
                continue
            try:
                answer: Plan | FfPlannerError | str = pickle.loads(lines.incoming)
            except (EOFError, pickle.UnpicklingError):  # it ended within the answer, or before
                if code:
                    raise _death(code) from None
            else:
                return answer

    def _replace_server(self) -> int:
        """End a server, and begin to load another; return the exit code of the first."""
        code = self._server.end()
        if not self._closed:
            self._server = _Server()
        return code


def _death(code: str) -> FfPlannerError:
    return FfPlannerError(
        Status.SOLVER_DIED,
        f"the solver process died with exit code {code} (-N: killed by signal N); "
        "a new one takes its place, the request may be sent again",
    )


class _Server:
    """The process that `solver_process.serve` runs in, and its forks."""

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            # A session of its own: Ctrl-C in a terminal is for the node; and a group to kill.
            self._process = subprocess.Popen(
                [sys.executable, "-m", solver_process.__name__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env=os.environ | ONE_THREAD,
                start_new_session=True,
            )
        self._is_loaded = False
        self._waited = 0.0  # for plans that it has not begun, since it began one [s]

    @property
    def is_loaded(self) -> bool:
        """Whether it is ready for plans."""
        if not self._is_loaded:
            with suppress(OSError):  # nothing has come in yet
                self._is_loaded = self._control.recv(_PACKET, socket.MSG_DONTWAIT) == LOADED
                self._waited = 0.0  # so far it has loaded, which takes longer than to begin
        return self._is_loaded and not self.has_died

    @property
    def has_died(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    @property
    def is_lost(self) -> bool:
        """Whether it has died, or was waited for so long that it hangs."""
        patience = _BEGINNING if self.is_loaded else _LOADING
        return self._waited > patience or self.has_died

    def begin(self, lines: Lines) -> None:
        """Begin a plan for whoever is at the other end of the lines."""
        with suppress(OSError):  # it has died, which `is_lost` tells
            socket.send_fds(self._control, [PLAN], lines.theirs, socket.MSG_DONTWAIT)

    def has_begun(self, lines: Lines) -> bool:
        """Wait a moment until the first packet of a plan comes in; whether it has."""
        before = time.monotonic()
        begun = lines.exchange()
        self._waited = 0.0 if begun else self._waited + time.monotonic() - before
        return begun

    def end(self) -> int:
        """End it, a plan that is being made included, and return its exit code."""
        self._control.close()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        return self._process.wait()
