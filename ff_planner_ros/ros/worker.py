"""The solver in a process of its own: planning never holds up a callback, and may even crash."""

from __future__ import annotations

import os
import pickle
import select
import subprocess
import sys
import time
import traceback
from typing import IO, cast

from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.time_budget import time_budget

# The search ends by itself at its next iteration. One that lasts longer than this share of the
# budget, or than what a new process takes to start [s], ends with its process.
_GRACE, _LEAST_GRACE = 0.1, 1.0


class Worker:
    """One solver process, replaced when it dies. One request at a time."""

    def __init__(self) -> None:
        """Start the process; it loads its libraries while the caller goes on."""
        self._closed = False
        self._process, self._loaded = _start(), False

    def solve(self, problem: PlanningProblem, settings: PlannerSettings, budget: float) -> Plan:
        """Plan in the other process and wait for the answer.

        Args:
            problem: What to plan.
            settings: How to plan it.
            budget: Wall clock that it may take [s].

        Raises:
            FfPlannerError: What the planner raised; or the process was overdue (OUT_OF_TIME),
                died or failed in a way that the planner does not foresee (INTERNAL_ERROR).
        """
        requests = cast(IO[bytes], self._process.stdin)
        answers = cast(IO[bytes], self._process.stdout)
        begun = time.monotonic()
        try:
            if not self._loaded:
                self._loaded = pickle.load(answers)
            pickle.dump((problem, settings, budget, begun), requests)
            requests.flush()
            patience = budget + max(_GRACE * budget, _LEAST_GRACE)
            if not select.select([answers], [], [], patience)[0]:
                raise self._overdue(budget)
            answer = pickle.load(answers)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            # A pipe that broke, within an answer or not, or was closed by `close`.
            raise self._replaced() from None
        if isinstance(answer, FfPlannerError):
            raise answer
        if isinstance(answer, str):
            raise FfPlannerError(Status.INTERNAL_ERROR, f"the planner failed: {answer}")
        return cast(Plan, answer)

    def close(self) -> None:
        """Stop the process; a request in progress is answered with INTERNAL_ERROR."""
        self._closed = True
        self._end_process()

    def _overdue(self, budget: float) -> FfPlannerError:
        """Give up the request in progress, and the process with it."""
        ended = self._replaced()
        if self._closed:
            return ended
        return NoPlanFound(
            Status.OUT_OF_TIME,
            f"the time budget of {budget:g} s is used up within a single iteration; whether there "
            "is a plan is not known: ask for fewer points or give it more time",
        )

    def _replaced(self) -> FfPlannerError:
        """Start a new process for the next request and say what happened to this one."""
        if self._closed:
            return FfPlannerError(Status.INTERNAL_ERROR, "the planner was shut down meanwhile")
        code = self._end_process()
        self._process, self._loaded = _start(), False
        return FfPlannerError(
            Status.INTERNAL_ERROR,
            f"the solver process died with exit code {code} (-N: killed by signal N); "
            "a new one is running, the request may be sent again",
        )

    def _end_process(self) -> int:
        """End the process, close its pipes and return its exit code."""
        self._process.kill()
        self._process.communicate()
        return self._process.returncode


def _start() -> subprocess.Popen[bytes]:
    # A session of its own: Ctrl-C in a terminal is for the node, which stops the worker.
    return subprocess.Popen(
        [sys.executable, "-m", "ff_planner_ros.ros.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )


def main() -> None:
    """Say that all is loaded, then answer requests until standard input closes: the node ended."""
    # Whatever a library prints must not land among the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    pickle.dump(True, answers)
    answers.flush()
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        pickle.dump(_answer(*request), answers)
        answers.flush()


def _answer(
    problem: PlanningProblem, settings: PlannerSettings, budget: float, begun: float
) -> Plan | FfPlannerError | str:
    """Plan; an error is an answer too, and one that nobody foresaw is told in words."""
    try:
        return plan(problem, settings, time_budget(budget, begun))
    except FfPlannerError as error:
        return error
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    main()
