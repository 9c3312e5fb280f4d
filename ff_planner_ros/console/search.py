"""A search in a thread of its own: its progress, its end, and how to cancel it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import Event, Thread

from ff_planner_ros.errors import EndedBy, FfPlannerError, OutOfTime, Status
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME, Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import SEARCHING, Progress, Watch
from ff_planner_ros.planning.task.task import PlanningTask, perform

_SHOWN = ("joint_path_length", "max_chaser_euler", "min_clearance")


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of a search."""

    task: PlanningTask
    plan: Plan | None  # None: refused or cancelled
    error: FfPlannerError | None  # None: there is a plan
    cancelled: bool = False  # before there was a plan


class Search:
    """A search, which begins at once."""

    def __init__(
        self,
        task: PlanningTask,
        told: Callable[[str], None],
        done: Callable[[Answer], None],
    ) -> None:
        """Begin to plan a task.

        Args:
            told: Called with the progress in words.
            done: Called with the answer; an unforeseen error is a refusal, INTERNAL_ERROR.
        """
        self._task, self._done = task, done
        self._watch = _Watch(told)
        self._thread = Thread(target=self._run, name="console search", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """End the search at its next step."""
        self._watch.cancelled.set()

    def wait(self) -> None:
        """Wait until the search has ended and `done` was called."""
        self._thread.join()

    def _run(self) -> None:
        found: Plan | None = None
        error: FfPlannerError | None = None
        try:
            found = perform(self._task, self._watch)
        except FfPlannerError as refused:
            error = refused
        except Exception as defect:  # whatever nobody thought of, so that the page goes on
            error = FfPlannerError(Status.INTERNAL_ERROR, f"{type(defect).__name__}: {defect}")
        # What was found before the search was cancelled is a plan like any other.
        cancelled = self._watch.cancelled.is_set() and found is None
        self._done(Answer(self._task, found, error, cancelled))


class _Watch(Watch):
    """Tells of the progress, and ends a search that is cancelled."""

    def __init__(self, told: Callable[[str], None]) -> None:
        self.cancelled = Event()
        self._told = told
        self._best: Metrics | None = None

    def require_time(self, phase: str = SEARCHING, /) -> None:
        if self.cancelled.is_set():
            raise OutOfTime(f"cancelled while {phase}", EndedBy.CANCEL)

    def offer(self, plan: Plan) -> None:
        self._best = plan.metrics

    def report(self, progress: Progress) -> None:
        self._told(progress_words(progress._replace(best=self._best)))


def progress_words(progress: Progress) -> str:
    """Return the progress of a search, and its best plan until then, in words."""
    starts = f"{progress.starts} initial guess{'es' if progress.starts != 1 else ''}"
    best = best_in_words(progress.best)
    return f"{progress.phase}, {starts}, {progress.iterations} iterations; {best}"


def best_in_words(metrics: Metrics | None) -> str:
    """Return the metrics of the best plan until now in words; None: no plan yet."""
    if metrics is None:
        return "no plan yet"
    shown = (
        f"{METRIC_BY_NAME[name].label} {METRIC_BY_NAME[name].text(getattr(metrics, name))}"
        for name in _SHOWN
    )
    return f"best so far: {', '.join(shown)}"
