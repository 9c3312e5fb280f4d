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

from ff_planner_ros.errors import FfPlannerError, Interrupted, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.planning.watch import Progress
from ff_planner_ros.ros.requests import solver_process
from ff_planner_ros.ros.requests.solver_process import KILL, LOADED, PLAN

# The search ends by itself at its next iteration. One that lasts longer than this share of the
# budget, or than what a loaded machine may hold it up for [s], ends with its process.
_GRACE, _LEAST_GRACE = 0.1, 1.0
# A process that was told to end has ended by then [s], on a busy machine, too; or its server hangs.
_LAST_RESPECTS = 0.5
# Loading takes a second; a server that needs so much longer [s] will not get there.
_LOADING = 60.0
# No packet of a server is longer [bytes].
_PACKET = 16


class Worker:
    """One solver, replaced when it dies. One plan at a time."""

    def __init__(self) -> None:
        """Start the process; it loads its libraries while the caller goes on."""
        self._server = _Server()
        self._solving, self._lock = threading.Lock(), threading.Lock()
        self._connection: socket.socket | None = None
        self._interrupted = self._closed = False

    def solve(
        self,
        task: PlanningTask,
        budget: float,
        check: Callable[[], None],
        report: Callable[[Progress], None],
    ) -> Plan:
        """Plan in another process and wait for the answer.

        Args:
            budget: Wall clock that it may take [s].
            check: Called right before it begins; what it raises ends the plan.
            report: Told now and then how far the search has come; what it raises ends the plan.

        Raises:
            Interrupted: By `interrupt`, which is heard from before `check` on, or `close`.
            FfPlannerError: What the planner raised; or the process was overdue (OUT_OF_TIME),
                died (SOLVER_DIED) or failed in a way that the planner does not foresee
                (INTERNAL_ERROR).
        """
        begun = time.monotonic()
        ours, theirs = socket.socketpair()
        with self._solving, ours, theirs:
            with self._lock:
                if self._closed:
                    raise Interrupted
                self._interrupted, self._connection = False, ours
            try:
                request = pickle.dumps((task, budget, begun))
                answer = self._asked(request, budget, check, report, ours, theirs)
            finally:
                with self._lock:
                    self._connection = None
            if self._interrupted:
                raise Interrupted
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

    def _asked(
        self,
        request: bytes,
        budget: float,
        check: Callable[[], None],
        report: Callable[[Progress], None],
        ours: socket.socket,
        theirs: socket.socket,
    ) -> Plan | FfPlannerError | str:
        """Return what the solver process answers, or what became of it."""
        answer: Plan | FfPlannerError | str | None = None
        check()
        try:
            if not self._server.loaded(unless=ours):
                raise Interrupted
            self._server.begin(theirs)
            theirs.close()
            patience = time.monotonic() + budget + max(_GRACE * budget, _LEAST_GRACE)
            answer = _exchange(ours, request, patience, report)
        except Interrupted:  # while it was loading: there is nothing to end
            raise
        except TimeoutError:
            code = self._exit_code(at_once=True)
            answer = NoPlanFound(
                Status.OUT_OF_TIME,
                f"the time budget of {budget:g} s is used up within a single iteration; whether "
                "there is a plan is not known: ask for fewer points or give it more time",
            )
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            # A connection that broke, within an answer or not.
            code = self._exit_code(at_once=True)
        except BaseException:  # `report` does not want the plan any more
            self._exit_code(at_once=True)
            raise
        else:
            code = self._exit_code(at_once=False)
        return answer or FfPlannerError(
            Status.SOLVER_DIED,
            f"the solver process died with exit code {code} (-N: killed by signal N); "
            "a new one takes its place, the request may be sent again",
        )

    def _exit_code(self, *, at_once: bool) -> int:
        """Wait for the end of a plan's process, or end it at once; replace a server that hangs."""
        code = self._server.exit_code(at_once=at_once)
        if code is None:
            code = self._server.end()
            if not self._closed:
                self._server = _Server()
        return code


def _exchange(
    connection: socket.socket,
    request: bytes,
    patience: float,
    report: Callable[[Progress], None],
) -> Plan | FfPlannerError | str:
    """Send a request and return its answer; TimeoutError at `patience`, of the monotonic clock."""
    connection.settimeout(max(patience - time.monotonic(), _LEAST_GRACE))
    connection.sendall(request)
    with connection.makefile("rb") as stream:
        while True:
            connection.settimeout(max(patience - time.monotonic(), 1e-3))
            answer: Plan | FfPlannerError | str | Progress = pickle.load(stream)
            if not isinstance(answer, Progress):
                return answer
            report(answer)


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

    def loaded(self, unless: socket.socket) -> bool:
        """Wait until it is ready for plans; False if something comes in on a socket before."""
        if not self._is_loaded:
            ready, _, _ = select.select([self._control, unless], [], [], _LOADING)
            if unless in ready:
                return False
            self._is_loaded = bool(ready) and self._control.recv(_PACKET) == LOADED
            if not self._is_loaded:
                raise EOFError
        return True

    def begin(self, connection: socket.socket) -> None:
        """Begin a plan for whoever is at the other end of a connection."""
        socket.send_fds(self._control, [PLAN], [connection.fileno()])

    def exit_code(self, *, at_once: bool) -> int | None:
        """Wait for the end of a plan's process, or end it at once; None: the server is no good."""
        try:
            if at_once:
                self._control.send(KILL)
            self._control.settimeout(_LAST_RESPECTS if at_once else _LEAST_GRACE)
            code = self._control.recv(_PACKET)
            self._control.settimeout(None)
        except OSError:  # a timeout is one, too
            return None
        return int(code) if code else None

    def end(self) -> int:
        """End it, a plan that is being made included, and return its exit code."""
        self._control.close()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        return self._process.wait()
