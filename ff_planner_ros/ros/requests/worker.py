"""The solver in processes of its own: planning never holds up a callback, and may even crash."""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO

from ff_planner_ros.errors import FfPlannerError, Interrupted, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.planning.watch import Progress
from ff_planner_ros.ros.requests import solver_process
from ff_planner_ros.ros.requests.solver_process import (
    ANSWERED,
    BEGUN,
    ENDED,
    LOADED,
    PLAN,
    PROGRESS,
)

# While a plan is made, whether it is still wanted is asked so often [s].
_POLL = 0.02
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
        self._connection: socket.socket | None = None
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
            time.sleep(_POLL)

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
                (OUT_OF_TIME), the process died (SOLVER_DIED) or failed in a way that the planner
                does not foresee (INTERNAL_ERROR).
        """

        def still_wanted() -> None:
            check()
            if time.monotonic() > begun + budget:
                raise NoPlanFound(
                    Status.OUT_OF_TIME,
                    f"the time budget of {budget:g} s is used up within a single iteration; "
                    "whether there is a plan is not known: ask for fewer points or give it more "
                    "time",
                )

        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with self._solving, ours, theirs, os.fdopen(os.memfd_create("plan"), "w+b") as paper:
            with self._lock:
                if self._closed:
                    raise Interrupted
                self._interrupted, self._connection = False, ours
            try:
                pickle.dump((task, budget, begun), paper)
                paper.flush()
                self._begin(ours, theirs, paper, still_wanted)
                theirs.close()
                answer = self._answer(ours, paper, still_wanted, report)
            finally:
                with self._lock:
                    self._connection = None
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
            if self._connection is not None:
                self._interrupted = True
                with suppress(OSError):  # broken by itself just now
                    self._connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End the plan that is being made and every process; there will be no other."""
        with self._lock:
            self._closed = True
        self.interrupt()
        with self._solving:
            self._server.end()

    def _begin(
        self,
        ours: socket.socket,
        theirs: socket.socket,
        paper: BinaryIO,
        still_wanted: Callable[[], None],
    ) -> None:
        """Have the solver begin a plan; one that has died or hangs is replaced, once."""
        replaced = False
        still_wanted()
        self._server.begin(theirs, paper)
        while not self._server.has_begun(ours):
            still_wanted()
            if self._server.is_lost:
                code = self._replace_server()
                if replaced:
                    raise _death(str(code))
                replaced = True
                self._server.begin(theirs, paper)
        if ours.recv(_PACKET) != BEGUN:
            raise Interrupted if self._interrupted else _death("unknown")

    def _answer(
        self,
        ours: socket.socket,
        paper: BinaryIO,
        still_wanted: Callable[[], None],
        report: Callable[[Progress], None],
    ) -> Plan | FfPlannerError | str:
        """Return what the solver process answers; who leaves before ends it by hanging up."""
        while True:
            still_wanted()
            if not _is_readable(ours, _POLL):
                continue
            packet = ours.recv(_PACKET)
            if self._interrupted:
                raise Interrupted
            kind, content = packet[:1], packet[1:]
            if kind == PROGRESS:
                report(pickle.loads(content))
            elif kind == ANSWERED:
                paper.seek(0)
                answer: Plan | FfPlannerError | str = pickle.load(paper)
                return answer
            else:  # ENDED, or nobody is left to say so
                raise _death(content.decode() if kind == ENDED else "unknown")

    def _replace_server(self) -> int:
        """End a server, and begin to load another; return the exit code of the first."""
        code = self._server.end()
        if not self._closed:
            self._server = _Server()
        return code


def _is_readable(connection: socket.socket, patience: float) -> bool:
    return bool(select.select([connection], [], [], patience)[0])


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
        return self._is_loaded and not self.has_died

    @property
    def has_died(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    @property
    def is_lost(self) -> bool:
        """Whether it has died, or was waited for so long that it hangs."""
        return self._waited > (_BEGINNING if self.is_loaded else _LOADING) or self.has_died

    def begin(self, connection: socket.socket, paper: BinaryIO) -> None:
        """Begin a plan for whoever is at the other end of a connection."""
        with suppress(OSError):  # it has died, which `is_lost` tells
            socket.send_fds(
                self._control,
                [PLAN],
                [connection.fileno(), paper.fileno()],
                socket.MSG_DONTWAIT,
            )

    def has_begun(self, connection: socket.socket) -> bool:
        """Wait a moment until something comes in on a plan's connection; whether it has."""
        before = time.monotonic()
        begun = _is_readable(connection, _POLL)
        self._waited = 0.0 if begun else self._waited + time.monotonic() - before
        return begun

    def end(self) -> int:
        """End it, a plan that is being made included, and return its exit code."""
        self._control.close()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        return self._process.wait()
