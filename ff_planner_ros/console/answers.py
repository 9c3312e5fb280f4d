"""Entries of the page from a planner node's answers, recorded or live."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ff_planner_ros.console.entries import PLANNED, Entry
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.messages.plans import metrics_from_message, plan_of_task
from ff_planner_ros.planning.task.task import PlanningTask

if TYPE_CHECKING:  # or it was decoded where ROS is not installed
    from ff_planner_msgs.msg import PlanAnswer


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
            plan = plan_of_task(task, answer)
        except InvalidInput as error:
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
