"""The solver's side of the pipes: one process that has everything loaded, and a fork per plan.

A fork takes milliseconds where a new process loads libraries for seconds: a plan that is
cancelled, crashes or overruns costs no more than itself, and what it leaks goes with it.
The forkserver of `multiprocessing` will not do: while it loads or hangs, `start` waits, and neither
a cancellation nor a time budget ends that; and each process would import the node's main module.
"""

from __future__ import annotations

import gc
import multiprocessing
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle
from typing import TypeAlias

from ff_planner_ros.errors import EndedBy, FfPlannerError, OutOfTime
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import SEARCHING, Budget, Progress
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.time_budget import TimeBudget

# A plan, a refusal, or the text of an unforeseen error.
Answer: TypeAlias = Plan | FfPlannerError | str

# Nobody reads faster; each report costs the reader some tens of microseconds.
_REPORT_INTERVAL = 0.02  # [s]
# Time that a search leaves for the check of the best attempt and the way of the answer: part of its
# budget, and at most [s].
_RESERVED, _MOST_RESERVED = 0.05, 0.5


def serve(requests: Connection) -> None:
    """Fork a process for every plan that is requested, until the node is gone.

    Args:
        requests: Sends a message once everything is loaded; then receives two handles per plan, of
            its control and its data connection. The control connection sends None when the plan is
            begun, and the exit code of its process when that has ended; the node closes it to end
            the plan. The data connection is for request, progress and answer; whatever follows the
            request ends the search.
    """
    # What only some searches load: a fork that needed it would load it again, plan after plan.
    import scipy.interpolate
    import scipy.stats  # noqa: F401

    gc.collect()
    gc.freeze()  # or else the first collection in a fork would copy all of the memory
    plans: dict[Connection, multiprocessing.context.ForkProcess] = {}  # by control connection
    requests.send("loaded")
    with suppress(EOFError, ConnectionError):  # the planner is gone
        while True:
            ready = wait([requests, *plans, *(process.sentinel for process in plans.values())])
            for control, process in list(plans.items()):
                if control in ready:
                    process.kill()
                if control in ready or process.sentinel in ready:
                    process.join()
                    with control, suppress(OSError):  # nobody listens
                        control.send(process.exitcode)
                    process.close()
                    del plans[control]
            if requests in ready:
                control = Connection(recv_handle(requests))
                with Connection(recv_handle(requests)) as data:
                    plans[control] = _forked(data)
                with suppress(OSError):  # nobody wants it any more
                    control.send(None)
    for process in plans.values():
        process.kill()


def _forked(data: Connection) -> multiprocessing.context.ForkProcess:
    context = multiprocessing.get_context("fork")
    process = context.Process(target=_make_plan, args=(data,), daemon=True)
    process.start()
    return process


def _make_plan(data: Connection) -> None:
    """Receive a request, send progress, then send the answer."""
    with suppress(EOFError, ConnectionError):  # nobody wants the plan any more
        task, budget, begun = data.recv()
        data.send(_answer(data, task, budget, begun))


class _Teller(TimeBudget):
    """Ends a search when its time is used up or it is cancelled; sends its progress."""

    def __init__(self, data: Connection, budget: Budget, begun: float) -> None:
        super().__init__(budget, begun, min(_RESERVED * min(budget), _MOST_RESERVED))
        self._data, self._reported = data, begun
        self._best: Metrics | None = None

    def require_time(self, phase: str = SEARCHING, /) -> None:
        super().require_time(phase)
        if self._data.poll():
            raise OutOfTime("the request was cancelled", EndedBy.CANCEL)

    def offer(self, plan: Plan) -> None:
        super().offer(plan)
        self._best = plan.metrics

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if now - self._reported >= _REPORT_INTERVAL:
            self._reported = now
            progress = replace(progress, best=self._best)
            self._data.send(progress)  # a reader that is gone ends the plan


def _answer(data: Connection, task: PlanningTask, budget: Budget, begun: float) -> Answer:
    """Return a plan, a refusal, or the text of an unforeseen error."""
    try:
        return perform(task, _Teller(data, budget, begun))
    except FfPlannerError as error:
        return error
    except ConnectionError:  # nobody wants the plan any more
        raise
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    # Ctrl-C in a terminal is for the node, which ends this process.
    serve(Connection(int(sys.argv[1])))
