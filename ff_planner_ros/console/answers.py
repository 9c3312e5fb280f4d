"""Entries of the page from a planner node's answers, recorded or live."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.console.entries import PLANNED, Entry
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.plans import metrics_from_message, plan_from_answer
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.task.task import PlanningTask


def entry_of_answer(
    name: str, task: PlanningTask | None, answer: PlanAnswer, missing: str = ""
) -> Entry:
    """Return the entry of a request's answer.

    Args:
        task: Task of the request; None: not known, nothing is drawn.
        missing: Why the task is not known.
    """
    code = answer.status.code
    status = Status(code) if code in iter(Status) else None
    plan = None
    if status is Status.SOLVED and task is not None:
        try:
            plan = _plan_of(answer)
        except (ValueError, IndexError) as error:
            missing = f"its motion cannot be read: {error}"
    words = answer.status.message
    # Why a request was refused is why it cannot be read again: nothing else is said twice.
    if missing and missing != words:
        words = f"{words} (not drawn: {missing})"
    is_refused = status not in (None, Status.SOLVED)
    return Entry(
        name,
        task,
        plan,
        error=FfPlannerError(Status(code), answer.status.message) if is_refused else None,
        status=_word(status),
        words=words,
        given=metrics_from_message(answer.metrics[0]) if answer.metrics else None,
        plan_id=answer.plan_id,
    )


def _word(status: Status | None) -> str:
    if status is None:
        return "unknown status"
    return PLANNED if status is Status.SOLVED else f"refused, {status.name}"


def _plan_of(answer: PlanAnswer) -> Plan:
    """Return the plan of an answer, with those of the phases that follow."""
    first, *others = (plan_from_answer(_alone(answer, k)) for k in range(len(answer.plans)))
    return replace(first, then=tuple(others))


def _alone(answer: PlanAnswer, phase: int) -> PlanAnswer:
    one = copy(answer)
    one.plans = [answer.plans[phase]]
    return one
