"""The solver's side of the pipe: one process that has everything loaded, and a fork per plan.

A fork takes milliseconds where a new process loads libraries for seconds: a plan that is
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
from contextlib import suppress
from dataclasses import dataclass

from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Progress
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.time_budget import TimeBudget

# What the server says when it is ready, and what it is told, with two connections.
LOADED, PLAN = b"loaded", b"plan"
# First byte of a packet on a plan's first connection: it is begun, how far it is, its process has
# ended with an exit code.
BEGUN, PROGRESS, ENDED = b"b", b"p", b"e"
# Nobody reads faster; each report costs the reader some tens of microseconds.
_REPORT_INTERVAL = 0.02  # [s]
# Of its budget a search leaves so much for what comes after it: the check of the best attempt and
# the answer's way; part of the budget, and at most [s].
_RESERVED, _MOST_RESERVED = 0.05, 0.5


@dataclass
class _Running:
    """A plan that is being made."""

    child: int  # process number
    ended: int  # descriptor of the process, readable when it has ended
    connection: socket.socket  # hangs up when nobody wants the plan any more
    is_doomed: bool = False  # killed, and not yet ended


def serve(control: socket.socket) -> None:
    """Make a plan whenever one is asked for, until the planner is gone.

    Args:
        control: Of packets: LOADED goes out once, then PLAN comes in with two connections: one of
            packets, and a stream that the request comes in on and the answer goes out on.
    """
    # What only some searches load: a fork that needed it would load it again, plan after plan.
    import scipy.interpolate
    import scipy.stats  # noqa: F401

    gc.collect()
    gc.freeze()  # or else the first collection in a fork would copy all of the memory
    plans: list[_Running] = []
    control.send(LOADED)
    while True:
        ready = _ready(control, plans)
        for plan in list(plans):
            if plan.ended in ready:
                _bury(plan)
                plans.remove(plan)
            elif plan.connection.fileno() in ready:
                _kill(plan)
        if control.fileno() in ready:
            message, descriptors, _, _ = socket.recv_fds(control, len(PLAN), 2)
            if not message:
                for plan in plans:
                    _kill(plan)
                return
            plans.append(_begun(control, plans, *descriptors))


def _ready(control: socket.socket, plans: list[_Running]) -> set[int]:
    """Wait for the next request, the end of a process, or a connection that is hung up."""
    watched = select.poll()
    watched.register(control, select.POLLIN)
    for plan in plans:
        watched.register(plan.ended, select.POLLIN)
        if not plan.is_doomed:
            watched.register(plan.connection, 0)  # hanging up is told unasked
    return {descriptor for descriptor, _ in watched.poll()}


def _begun(
    control: socket.socket, plans: list[_Running], connection_fd: int, stream_fd: int
) -> _Running:
    """Fork, and make the plan there."""
    connection = socket.socket(fileno=connection_fd)
    child = os.fork()
    if child == 0:
        try:
            control.close()
            for other in plans:
                os.close(other.ended)
                other.connection.close()
            with socket.socket(fileno=stream_fd) as stream:
                _make_plan(connection, stream)
        except BrokenPipeError:  # nobody wants the plan any more
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    os.close(stream_fd)
    return _Running(child, os.pidfd_open(child), connection)


def _kill(plan: _Running) -> None:
    signal.pidfd_send_signal(plan.ended, signal.SIGKILL)
    plan.is_doomed = True


def _bury(plan: _Running) -> None:
    """Tell the exit code of a process that has ended, if anybody still listens."""
    code = os.waitstatus_to_exitcode(os.waitpid(plan.child, 0)[1])
    with suppress(OSError), plan.connection:
        plan.connection.send(ENDED + str(code).encode(), socket.MSG_DONTWAIT)
    os.close(plan.ended)


def _make_plan(connection: socket.socket, stream: socket.socket) -> None:
    """Read a request, tell of the progress, and write the answer."""
    connection.send(BEGUN)
    with stream.makefile("rb") as incoming:
        task, budget, begun = pickle.load(incoming)
    stream.sendall(pickle.dumps(_answer(connection, task, budget, begun)))


class _Teller(TimeBudget):
    """Ends a search when its time is used up, and tells its progress to whoever waits."""

    def __init__(self, connection: socket.socket, budget: float, begun: float) -> None:
        super().__init__(budget, begun - min(_RESERVED * budget, _MOST_RESERVED))
        self._connection, self._reported = connection, begun

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if now - self._reported >= _REPORT_INTERVAL:
            self._reported = now
            # A reader that is behind misses some; one that is gone ends the plan.
            with suppress(BlockingIOError):
                self._connection.send(PROGRESS + pickle.dumps(progress), socket.MSG_DONTWAIT)


def _answer(
    connection: socket.socket, task: PlanningTask, budget: float, begun: float
) -> Plan | FfPlannerError | str:
    """Plan; a refusal is an answer too, and an error that nobody foresaw is told in words."""
    try:
        return perform(task, _Teller(connection, budget, begun))
    except FfPlannerError as error:
        return error
    except BrokenPipeError:  # nobody wants the plan any more
        raise
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    # Ctrl-C in a terminal is for the node, which ends this process.
    serve(socket.socket(fileno=int(sys.argv[1])))
