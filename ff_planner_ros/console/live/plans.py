"""The plans of a running node that a console knows, with their status."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import RLock

from ff_planner_msgs.msg import Exchange, PlanEvent, PublishedPlan
from ff_planner_msgs.msg import Plan as PlanMessage

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.console.answers import entry_of_answer
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.live.link import Link
from ff_planner_ros.errors import FfPlannerError, InvalidInput
from ff_planner_ros.messages.exchange_words import REFUSED_EARLY
from ff_planner_ros.messages.trajectories import trajectory_in
from ff_planner_ros.planning.problem.problem import lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.task_json import task_from_json, urdf_digest
from ff_planner_ros.planning.task.captured import captured_in
from ff_planner_ros.planning.task.controller_rules import require_in_time
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan as RunningPlan
from ff_planner_ros.ros.outputs.prediction import Deviation
from ff_planner_ros.ros.requests.publication import (
    require_same_start,
    require_young,
    start_deviations,
)
from ff_planner_ros.ros.requests.reading import Knowledge, measured_state

WAITS = "waits for approval"
_EVENTS = {
    PlanEvent.STARTED: "runs",
    PlanEvent.AT_GOAL: "at its goal",
    PlanEvent.ABORTED: "aborted",
    PlanEvent.SUPERSEDED: "superseded",
}


@dataclass(frozen=True, eq=False)
class Fit:
    """Whether a plan that waits can be published now."""

    age: float  # since it was made [s]
    until_start: float  # negative: its start is over [s]
    deviations: Sequence[Deviation]  # of the system from its first point; empty: not known
    refusal: str  # why the node would refuse it now; empty: it would not, as far as is known here


@dataclass(frozen=True, eq=False)
class _Known:
    """A plan, or a refusal."""

    entry: Entry
    made: MadePlan | None = None  # None: there is no plan


class Plans:
    """The node's answers since the console was opened, by plan id."""

    def __init__(self, link: Link, changed: Callable[[Entry], None]) -> None:
        """Begin without plans; `changed` is called with every entry whose status changes."""
        self._link, self._changed = link, changed
        self._lock = RLock()
        self._known: dict[str, _Known] = {}  # by plan id
        self._runs: list[str] = []  # runs of the node, by the prefixes of its plan ids

    def answered(self, exchange: Exchange, asked: PlanningTask | None) -> Entry:
        """Add an answer, and return its entry; an answer that is known already stays as it is.

        Args:
            exchange: Has a request and its answer.
            asked: Task of the request, if the console made it; None: not known.
        """
        (request,), (answer,) = exchange.request, exchange.answer
        with self._lock:
            before = self._known.get(answer.plan_id)
            if before is not None:
                return before.entry
            task, missing = self._task(exchange.task, asked)
            entry = entry_of_answer(self._name(answer.plan_id), task, answer, missing)
            made = None
            if entry.plan is not None and task is not None and answer.plans:
                start_ns = nanoseconds(answer.plans[0].joint_trajectory.header.stamp)
                made = MadePlan(
                    answer.plan_id,
                    whole(entry.plan),
                    start_ns,
                    str(task.end_behaviour),
                    task.problem.robot,
                    scene_of(lasting(task.problem, entry.plan.duration)),
                    self._link.parameters.inertial_frame,
                    answer.inputs.previous_plan_id,
                    self._link.now_ns(),
                )
                if request.plan_only:
                    entry = replace(entry, status=WAITS)
            self._known[answer.plan_id] = _Known(entry, made)
            return entry

    def waiting(self, entry: Entry) -> MadePlan | None:
        """Return the plan of an entry if it waits to be published, else None."""
        known = self._known.get(entry.plan_id)
        return known.made if known is not None and known.entry.status == WAITS else None

    def name_of(self, plan_id: str) -> str:
        """Return the name by which a plan is listed, or else its id."""
        known = self._known.get(plan_id)
        return plan_id if known is None else known.entry.name

    def reject(self, plan_id: str) -> None:
        """Mark a plan as rejected, because the node has dropped it."""
        self._becomes(plan_id, "rejected")

    def published(self, message: PublishedPlan) -> None:
        """Mark a plan as published; the joints follow it from its start on."""
        known, last = self._known.get(message.plan_id), self._link.published
        start_ns = nanoseconds(message.start_time)
        if known is None or known.made is None:
            # The message has no motion of the chaser.
            motion = trajectory_in(PlanMessage(joint_trajectory=message.joint_trajectory))
            self._link.published = RunningPlan(message.plan_id, motion, start_ns)
            return
        made = known.made
        self._link.published = RunningPlan(
            made.plan_id,
            made.plan.trajectory,
            start_ns,
            captured_in(made.scene),
            made.plan.duration,
            None if last is None else last.until(made.previous_plan_id, self._link.now_ns()),
            made.plan.wheels,
        )
        self._becomes(message.plan_id, f"published by {message.requester}")

    def happened(self, event: PlanEvent) -> None:
        """Update the status of a published plan from its event."""
        if event.event not in _EVENTS:
            return
        words = _EVENTS[event.event]
        if event.event == PlanEvent.ABORTED:
            words = f"{words}: {event.message}"
            last = self._link.published
            if last is not None and last.plan_id == event.plan_id:
                self._link.published = None
        elif event.event == PlanEvent.SUPERSEDED:
            words = f"{words} by {self.name_of(event.successor)}"
        self._becomes(event.plan_id, words)

    def _becomes(self, plan_id: str, status: str) -> None:
        with self._lock:
            known = self._known.get(plan_id)
            if known is None or known.entry.status == status:
                return
            entry = replace(known.entry, status=status)
            # Kept, because they take long to compute and stay the same.
            for name in ("stages", "fault", "metrics"):
                if name in vars(known.entry):
                    vars(entry)[name] = vars(known.entry)[name]
            self._known[plan_id] = replace(known, entry=entry)
        self._changed(entry)

    def _task(self, text: str, asked: PlanningTask | None) -> tuple[PlanningTask | None, str]:
        """Return the task of an answer, or else the one that was asked for, and why it has none."""
        if not text:
            return asked, REFUSED_EARLY if asked is None else ""
        urdf = self._link.robot.drawn_urdf
        try:
            return task_from_json(text, {urdf_digest(urdf): urdf}), ""
        except InvalidInput as error:
            return None, str(error)

    def _name(self, plan_id: str) -> str:
        run, _, number = plan_id.rpartition(".")
        if run not in self._runs:
            self._runs.append(run)
        start = self._runs.index(run) + 1
        return f"plan {number}" if start == 1 else f"plan {number} of start {start}"


def fit_of(made: MadePlan, knowledge: Knowledge) -> Fit:
    """Return whether a plan that waits can be published now, by the node's own checks."""
    deviations: Sequence[Deviation] = ()
    refusal = ""
    try:
        deviations = start_deviations(made, measured_state((), knowledge), knowledge)
        require_in_time(made.start_ns, knowledge.now_ns)
        require_young(made, knowledge)
        require_same_start(made, deviations, knowledge)
    except FfPlannerError as error:
        refusal = f"{error.status.name}: {error}"
    return Fit(
        made.age(knowledge.now_ns),
        (made.start_ns - knowledge.now_ns) / NANOSECONDS,
        deviations,
        refusal,
    )
