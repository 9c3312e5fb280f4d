"""Entries of the page: tasks with their plans or refusals, and how the page plans them."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias

from ff_planner_ros.console.colours import STYLE
from ff_planner_ros.console.faults import Place, attempt_in, place_of_fault
from ff_planner_ros.console.search import Answer, Search
from ff_planner_ros.console.stages import Stage, stages_of
from ff_planner_ros.errors import FfPlannerError, NoPlanFound
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME, Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.optimisation.objectives import weighted_sum
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.planning.task.whole import whole

# Columns of the table, and the metric of each.
_COLUMNS = {
    "joint path": "joint_path_length",
    "attitude": "max_chaser_euler",
    "clearance": "min_clearance",
    "torque": "peak_joint_torques",
}

PLANNED = "planned"


@dataclass(frozen=True, eq=False)
class Entry:
    """A task, with its plan or the refusal."""

    name: str
    task: PlanningTask | None  # None: not known, there is nothing to draw
    plan: Plan | None = None
    error: FfPlannerError | None = None  # why there is no plan
    status: str = ""  # in a word
    words: str = ""  # the answer's message
    given: Metrics | None = None  # of the answer, where they are not those of the plan
    plan_id: str = ""  # of a running node's answer; empty: planned here, or recorded

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Phases to draw: of the plan, of the best attempt, or the robot at its start."""
        if self.task is None:
            return ()
        motion = self.plan
        if motion is None and self.error is not None:
            motion = attempt_in(self.error)
        return stages_of(self.task, motion)

    @cached_property
    def fault(self) -> Place | None:
        """Place in the scene that caused a refusal; None: no refusal, or its cause has no place."""
        if self.task is None or self.error is None:
            return None
        return place_of_fault(self.task, self.error)

    @cached_property
    def metrics(self) -> Metrics | None:
        """Metrics of the plan, of all phases as one, or of the best attempt; None: neither."""
        if self.given is not None or self.plan is None:
            attempt = self.error.attempt if isinstance(self.error, NoPlanFound) else None
            return self.given or (attempt.metrics if isinstance(attempt, Plan) else None)
        return whole(self.plan).metrics

    @property
    def objective(self) -> str:
        """Value of the plan's objective, with the weights of the task, as text."""
        metrics = self.metrics
        if self.task is None or self.plan is None or metrics is None:
            return "-"
        weights, seconds = self.task.problem.objective, self.plan.duration or 0.0
        return f"{weighted_sum(weights, metrics) + weights.duration * seconds:.4f}"


def entry_of(name: str, answer: Answer) -> Entry:
    """Return the entry of a search on the page."""
    if answer.plan is not None:
        message = answer.plan.message
        return Entry(name, answer.task, answer.plan, status=PLANNED, words=message)
    error = answer.error
    status = "cancelled" if answer.cancelled else "refused" if error is None else _named(error)
    return Entry(name, answer.task, error=error, status=status, words=str(error))


class Running(Protocol):
    """A search that runs."""

    def cancel(self) -> None:
        """End the search at its next step."""

    def wait(self) -> None:
        """Wait until the search has ended and passed on its entry."""


# Begins to plan a task; the callbacks take the progress in words, and the entry at the end.
Begin: TypeAlias = Callable[[PlanningTask, Callable[[str], None], Callable[[Entry], None]], Running]


class PlansHere:
    """Plans in this process."""

    def __init__(self) -> None:
        """Start the numbers of plans at 1."""
        self._planned = 0

    def __call__(
        self, task: PlanningTask, told: Callable[[str], None], done: Callable[[Entry], None]
    ) -> Running:
        """Begin to plan a task; see `Begin`."""
        self._planned += 1
        name = f"plan {self._planned}"
        return Search(task, told, lambda answer: done(entry_of(name, answer)))


def table_of(entries: Sequence[Entry], chosen: Entry) -> str:
    """Return all entries as a table in HTML, the chosen one in bold."""
    heads = ["plan", "objective"]
    for head, name in _COLUMNS.items():
        heads.append(f"{head} [{METRIC_BY_NAME[name].shown_unit}]")
    rows = [_row(entry, entry is chosen) for entry in entries]
    head = "".join(f"<th>{html.escape(text)}</th>" for text in heads)
    return f"{STYLE}<div class='ff'><table><tr>{head}</tr>{''.join(rows)}</table></div>"


def _row(entry: Entry, is_chosen: bool) -> str:
    metrics = entry.metrics
    values = [
        "-" if metrics is None else METRIC_BY_NAME[name].shown(getattr(metrics, name))
        for name in _COLUMNS.values()
    ]
    name = entry.name if entry.status == PLANNED else f"{entry.name}: {entry.status}"
    cells = [entry.objective, *values]
    of_row = " class='chosen'" if is_chosen else ""
    told = (f"<td>{html.escape(cell)}</td>" for cell in (name, *cells))
    return f"<tr{of_row}>{''.join(told)}</tr>"


def in_words(entry: Entry) -> str:
    """Return name, status and message of an entry, in HTML."""
    where = "" if entry.fault is None else f" (marked in the scene: {entry.fault.words})"
    said = html.escape(f"{entry.words}{where}")
    named = html.escape(f"{entry.name}: {entry.status}")
    return f"{STYLE}<div class='ff'><p><b>{named}</b> {said}</p></div>"


def _named(error: FfPlannerError) -> str:
    return f"refused, {error.status.name}"
