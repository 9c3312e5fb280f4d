"""Entries of the page from the requests in a bag and their answers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from ff_planner_ros.bag.exchanges import Exchange
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.console.answers import entry_of_answer
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.runs.replay import replayable


def entries_of_bag(bag: Path) -> tuple[list[Entry], tuple[str, ...]]:
    """Return an entry for each request, and notes on the bag.

    Raises:
        BagError: The bag cannot be read, or holds no request.
    """
    with open_bag(bag) as opened:
        entries, names = list[Entry](), Counter[str]()
        for request in replayable(opened):
            names[request.plan_id] += 1
            again = names[request.plan_id]
            name = request.plan_id if again == 1 else f"{request.plan_id} ({again})"
            entries.append(_entry(name, request))
        return entries, opened.notes


def _entry(name: str, request: Exchange) -> Entry:
    task: PlanningTask | None = None
    missing = ""
    try:
        task = request.planned_task()
    except FfPlannerError as error:
        missing = str(error)
    if request.answer is None:
        return Entry(name, task, status="no answer", words=missing)
    return entry_of_answer(name, task, request.answer, missing)
