"""The solver's side of the pipe: one process that has everything loaded, and a fork per plan.

A fork takes milliseconds where a new process loads libraries for a second: a plan that is
cancelled, crashes or overruns costs no more than itself, and what it leaks goes with it.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import signal
import socket
import sys
import time
import traceback
from typing import BinaryIO, cast

from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.task import PlanningTask, perform
from ff_planner_ros.planning.watch import Progress
from ff_planner_ros.time_budget import TimeBudget

# What the planner says to the server, and the server says first of all.
PLAN, KILL, LOADED = b"plan", b"kill", b"loaded"
# Nobody reads faster; each report costs the reader some tens of microseconds.
_REPORT_INTERVAL = 0.02  # [s]


def serve(control: socket.socket) -> None:
    """Make a plan for each connection that comes in, one at a time, until the planner is gone.

    Args:
        control: Of packets: PLAN with a connection or KILL come in; LOADED and then, for each
            plan, the exit code of its process as text go out.
    """
    gc.collect()
    gc.freeze()  # or else the first collection in a fork would copy all of the memory
    control.send(LOADED)
    while True:
        message, descriptors, _, _ = socket.recv_fds(control, len(PLAN), 1)
        if not message:
            return
        if message == KILL:  # came when the plan was done already
            continue
        (connection,) = descriptors
        child = os.fork()
        if child == 0:
            control.close()
            _make_plan(socket.socket(fileno=connection))
            os._exit(0)
        os.close(connection)
        code = _exit_code(child, control)
        control.send(str(code).encode())


def _exit_code(child: int, control: socket.socket) -> int:
    """Wait for a child to end, or end it when told to or when there is nobody left to tell."""
    ended = os.pidfd_open(child)
    ready, _, _ = select.select([ended, control.fileno()], [], [])
    if ended not in ready:
        control.recv(len(KILL))
        os.kill(child, signal.SIGKILL)
    os.close(ended)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _make_plan(connection: socket.socket) -> None:
    """Read a request, write progress and at last the answer."""
    with connection, cast(BinaryIO, connection.makefile("rwb")) as stream:
        request = pickle.load(stream)
        pickle.dump(_answer(stream, *request), stream)


class _Teller(TimeBudget):
    """Ends a search when its time is used up, and writes its progress to whoever waits."""

    def __init__(self, stream: BinaryIO, budget: float, begun: float) -> None:
        super().__init__(budget, begun)
        self._stream, self._reported = stream, begun

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if now - self._reported >= _REPORT_INTERVAL:
            self._reported = now
            pickle.dump(progress, self._stream)
            self._stream.flush()


def _answer(
    stream: BinaryIO, task: PlanningTask, budget: float, begun: float
) -> Plan | FfPlannerError | str:
    """Plan; a refusal is an answer too, and an error that nobody foresaw is told in words."""
    try:
        return perform(task, _Teller(stream, budget, begun))
    except FfPlannerError as error:
        return error
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    # Ctrl-C in a terminal is for the node, which ends this process.
    serve(socket.socket(fileno=int(sys.argv[1])))
