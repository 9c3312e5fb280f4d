"""The solver's side of the pipes: one process that has everything loaded, and forks that plan.

A fork takes milliseconds where a new process loads libraries for seconds: a plan that is
cancelled, crashes or overruns costs no more than itself, with its process. One that was answered
leaves its process to the next plan, which takes some 20 ms less than in a new fork: that copies
4,400 pages of memory as it writes to them.
The forkserver of `multiprocessing` will not do: while it loads or hangs, `start` waits, and neither
a cancellation nor a time budget ends that; and each process would import the node's main module.
"""

from __future__ import annotations

import gc
import multiprocessing
import resource
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path
from typing import TypeAlias

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import EndedBy, FfPlannerError, OutOfTime
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import SEARCHING, Budget, Progress
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.time_budget import TimeBudget

# A plan, a refusal, or the text of an unforeseen error.
Answer: TypeAlias = Plan | FfPlannerError | str

# Nobody reads faster; each report costs the reader some tens of microseconds.
_REPORT_INTERVAL = 0.02  # [s]
# Time that a search leaves for the check of the best attempt and the way of the answer: part of its
# budget, and at most [s].
_RESERVED, _MOST_RESERVED = 0.05, 0.5
# Points of the plans before the first request, and their time budget [s]: on an idle machine
# both together take a third of it.
_FEW_POINTS, _REHEARSAL = 13, 1.0
# What plans leak goes with their process, which ends after so many. And it ends when it has grown
# by so much [bytes]: plans of up to 500 points left 106 MB, which grew no more in 200 of them; of
# more points they left 300 MB, and last so long that a fork does not matter.
_MOST_PLANS, _MOST_GROWTH = 50, 128 << 20


def serve(requests: Connection) -> None:
    """Have every plan that is requested made in another process, until the node is gone.

    Args:
        requests: Sends a message once it has planned; then receives two handles per plan, of its
            control and its data connection. The control connection sends None when the plan is
            begun, and the exit code of its process when that has ended. The node sends a message on
            it once it has the answer, so that the process may make the next plan; without it, the
            node closes it to end the process. The data connection is for request, progress and
            answer; whatever follows the request ends the search.
    """
    gc.collect()
    gc.freeze()  # or else the first collection in a fork would copy all of the memory
    plans: dict[Connection, _Fork] = {}  # by control connection
    idle: _Fork | None = _rehearsed()
    requests.send("loaded")
    with suppress(EOFError, ConnectionError):  # the planner is gone
        while True:
            ready = wait([requests, *plans, *(fork.sentinel for fork in plans.values())])
            for control, fork in list(plans.items()):
                if control in ready and _is_answered(control):
                    if idle:
                        idle.end()
                    idle = fork
                elif control in ready or fork.sentinel in ready:
                    with suppress(OSError):  # nobody listens
                        control.send(fork.end())
                else:
                    continue
                control.close()
                del plans[control]
            if idle and not idle.is_fit:
                idle.end()
                idle = None
            if requests in ready:
                control = Connection(recv_handle(requests))
                plans[control], idle = idle or _Fork(), None
                with Connection(recv_handle(requests)) as data:
                    plans[control].begin(data)
                with suppress(OSError):  # nobody wants it any more
                    control.send(None)
    for fork in [*plans.values(), *([idle] if idle else [])]:
        fork.end()


def _rehearsed() -> _Fork:
    """Return a process that has planned, be it in vain."""
    fork = _Fork()
    with suppress(FfPlannerError, EOFError, OSError):  # without tasks, or it has died
        for task in rehearsal():
            ours, data = Pipe()
            with ours:
                with data:
                    fork.begin(data)
                ours.send((task, Budget(_REHEARSAL), time.monotonic()))
                while isinstance(ours.recv(), Progress):
                    pass
    return fork


def rehearsal() -> list[PlanningTask]:
    """Return small tasks of the package's own robot, which try most of what searches try.

    Lines and shapes, both families of paths, the shortest joint path and the least attitude.

    Raises:
        InvalidInput: A file of the package is missing or changed.
    """
    settings = replace(load_parameters().planner, threads=1, search=SearchDepth.QUICK)
    scenarios = share_directory() / "config" / "scenarios"
    lines, shapes = (
        load_task(scenarios / f"{name}.yaml", Defaults(settings))
        for name in ("lemur_capture", "lemur_capture_bodies")
    )
    steady = replace(lines.problem, objective=Objective(0.0, 1.0))
    return [
        replace(lines, problem=replace(problem, points=_FEW_POINTS))
        for problem in (shapes.problem, steady)
    ]


def _is_answered(control: Connection) -> bool:
    """Return whether the node has the answer; if not, it has closed the connection."""
    try:
        control.recv()
    except (EOFError, OSError):
        return False
    return True


class _Fork:
    """A process that makes one plan after another."""

    def __init__(self) -> None:
        self._link, its_link = Pipe()
        self._process = multiprocessing.get_context("fork").Process(
            target=_make_plans, args=(its_link, self._link), daemon=True
        )
        with its_link:
            self._process.start()
        self._plans, self._memory = 0, self._own_memory()

    @property
    def sentinel(self) -> int:
        """Is ready once the process has ended."""
        return self._process.sentinel

    @property
    def is_fit(self) -> bool:
        """Whether it may make another plan."""
        if self._plans >= _MOST_PLANS or not self._process.is_alive():
            return False
        return self._own_memory() - self._memory < _MOST_GROWTH

    def begin(self, data: Connection) -> None:
        """Have it make a plan."""
        self._plans += 1
        with suppress(OSError):  # it has died, which its sentinel tells
            send_handle(self._link, data.fileno(), self._process.pid)

    def end(self) -> int | None:
        """End it and return its exit code."""
        self._process.kill()
        self._process.join()
        code = self._process.exitcode
        self._process.close()
        self._link.close()
        return code

    def _own_memory(self) -> int:
        """Return the memory that is backed by no file [bytes]."""
        resident, of_files = Path(f"/proc/{self._process.pid}/statm").read_text().split()[1:3]
        return (int(resident) - int(of_files)) * resource.getpagesize()


def _make_plans(link: Connection, its_other_end: Connection) -> None:
    """Make a plan for every data connection that comes, until the server is gone."""
    its_other_end.close()  # or else the link would outlive the server
    with suppress(EOFError, OSError):
        while True:
            with Connection(recv_handle(link)) as data:
                _make_plan(data)
            gc.collect()  # while nobody waits


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
            progress = progress._replace(best=self._best)
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
