"""The solver's side of the pipe: a process that has everything loaded, and makes plans.

A plan takes a process that has planned before some 40 ms less than a new one, and a new one loads
its libraries for seconds.
"""

from __future__ import annotations

import gc
import pickle
import resource
import select
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeAlias

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import EndedBy, FfPlannerError, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import SEARCHING, Budget, PassingOn, Progress
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.time_budget import TimeBudget

Answer: TypeAlias = Plan | FfPlannerError

# What the process sends when it can make a plan: one of its share, or one more than that.
READY, WORN = "ready", "worn"
# What the node sends to end a search: the best plan until then is the answer.
CANCEL = "cancel"

# Nobody reads faster; each report costs the reader some tens of microseconds.
_REPORT_INTERVAL = 0.02  # [s]
# Time that a search leaves for the check of the best attempt and the way of the answer: part of its
# budget, and at most [s].
_RESERVED, _MOST_RESERVED = 0.05, 0.5
# Points of the plans before the first request, and their time budget [s]: on an idle machine
# both together take a third of it.
_FEW_POINTS, _REHEARSAL = 13, 1.0
# What plans leak goes with their process, which is replaced after so many, or when it has grown by
# so much [bytes].
_MOST_PLANS, _MOST_GROWTH = 1000, 128 << 20


def serve(link: Connection) -> None:
    """Make one plan after another until the node is gone.

    Args:
        link: Sends READY or WORN; then receives task, budget, and begin of the budget by the
            monotonic clock [s]; then sends progress and the answer, and begins again. CANCEL may
            come at any time: it ends the search, if there still is one.
    """
    _rehearse()
    gc.collect()
    gc.freeze()  # collections pass by what stays loaded
    memory = _own_memory()
    with suppress(EOFError, ConnectionError):  # the node is gone
        for plans in count():
            has_grown = _own_memory() - memory > _MOST_GROWTH
            link.send(WORN if has_grown or plans >= _MOST_PLANS else READY)
            while (request := link.recv()) == CANCEL:
                pass
            answer = _answer(link, *request)
            link.send(answer)
            if isinstance(answer, FfPlannerError) and answer.status is Status.INTERNAL_ERROR:
                return  # nobody knows what state this process is in
            del request, answer
            gc.collect()  # while nobody waits


def _rehearse() -> None:
    """Plan for the first time, be it in vain."""
    with suppress(FfPlannerError):  # without tasks
        for task in rehearsal():
            with suppress(FfPlannerError):  # without a plan
                perform(task, TimeBudget(Budget(_REHEARSAL)))


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


def _own_memory() -> int:
    """Return the memory of this process that is backed by no file [bytes]."""
    resident, of_files = Path("/proc/self/statm").read_text().split()[1:3]
    return (int(resident) - int(of_files)) * resource.getpagesize()


class _Teller(PassingOn):
    """Ends a search when its time is used up or it is cancelled; sends its progress."""

    def __init__(self, link: Connection, budget: Budget, begun: float) -> None:
        super().__init__(TimeBudget(budget, begun, min(_RESERVED * min(budget), _MOST_RESERVED)))
        self._link, self._reported = link, begun
        self._cancelled = select.poll()
        self._cancelled.register(link, select.POLLIN)
        self._best: Metrics | None = None

    def require_time(self, phase: str = SEARCHING, /) -> None:
        super().require_time(phase)
        if self._cancelled.poll(0):  # nothing else comes during a search
            raise OutOfTime("the request was cancelled", EndedBy.CANCEL)

    def offer(self, plan: Plan) -> None:
        super().offer(plan)
        self._best = plan.metrics

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if now - self._reported >= _REPORT_INTERVAL:
            self._reported = now
            self._link.send(progress._replace(best=self._best))  # ends the plan if nobody reads


def _answer(link: Connection, task: PlanningTask, budget: Budget, begun: float) -> Answer:
    """Return a plan, a refusal, or an unforeseen error as INTERNAL_ERROR."""
    try:
        return perform(task, _Teller(link, budget, begun))
    except FfPlannerError as error:
        return error
    except ConnectionError:  # the node is gone
        raise
    except Exception as error:
        traceback.print_exc()
        words = f"the planner failed: {type(error).__name__}: {error}"
        return FfPlannerError(Status.INTERNAL_ERROR, words)


@lru_cache(maxsize=2)
def robot_from(pickled: bytes) -> Robot:
    """Return a robot, the same one for the same bytes: what is computed of it is kept."""
    robot: Robot = pickle.loads(pickled)
    return robot


def main() -> None:
    """Make plans for the node; the argument is the descriptor of the link."""
    serve(Connection(int(sys.argv[1])))
