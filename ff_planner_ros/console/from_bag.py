"""The requests of a bag with their answers, refused ones too, as the page lists them."""

from __future__ import annotations

from collections import Counter
from copy import copy
from dataclasses import replace
from pathlib import Path

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.messages.from_messages import metrics_from_message, plan_from_answer
from ff_planner_ros.runs.recorded_run import RecordedRequest, recorded_run


def entries_of_bag(bag: Path) -> tuple[list[Entry], tuple[str, ...]]:
    """Return an entry for each request in the order in which they came, and notes on the bag.

    Raises:
        BagError: The bag cannot be read, or holds no request, or neither robot nor parameters.
        InvalidInput: The URDF in it is refused.
    """
    with open_bag(bag) as opened:
        run = recorded_run(opened)
        entries = list[Entry]()
        names = Counter[str]()
        for request in run.requests:
            names[request.name] += 1
            again = names[request.name]
            name = request.name if again == 1 else f"{request.name} ({again})"
            entries.append(_entry(name, request))
    return entries, run.notes


def _entry(name: str, request: RecordedRequest) -> Entry:
    task: PlanningTask | None = None
    missing = ""
    try:
        task = request.read_request().task
    except FfPlannerError as error:
        missing = str(error)
    answer = request.response
    if answer is None:
        return Entry(name, task, status="no answer", words=missing)
    plan = None
    if request.status is Status.SOLVED and task is not None:
        try:
            plan = _plan_of(answer)
        except (ValueError, IndexError) as error:
            missing = f"its motion cannot be read: {error}"
    words = answer.status.message
    # Why a request was refused is why it cannot be read again: nothing else is said twice.
    if missing and missing != words:
        words = f"{words} (not drawn: {missing})"
    return Entry(
        name,
        task,
        plan,
        error=_error(request),
        status=_status(request),
        words=words,
        given=metrics_from_message(answer.metrics[0]) if answer.metrics else None,
    )


def _status(request: RecordedRequest) -> str:
    if request.status is None:
        return "unknown status"
    return "planned" if request.status is Status.SOLVED else f"refused, {request.status.name}"


def _error(request: RecordedRequest) -> FfPlannerError | None:
    """Return the recorded refusal; None: it is none, or has a status that is not known here."""
    status, answer = request.status, request.response
    if status is None or answer is None or status is Status.SOLVED:
        return None
    return FfPlannerError(status, answer.status.message)


def _plan_of(answer: PlanAnswer) -> Plan:
    """Return the plan of an answer, with those of the phases that follow."""
    first, *others = (plan_from_answer(_alone(answer, k)) for k in range(len(answer.plans)))
    return replace(first, then=tuple(others))


def _alone(answer: PlanAnswer, phase: int) -> PlanAnswer:
    one = copy(answer)
    one.plans = [answer.plans[phase]]
    return one
