"""Entries of the page from the requests in a bag and their answers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.console.answers import entry_of_answer
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.runs.recorded_run import RecordedRequest, recorded_run


def entries_of_bag(bag: Path) -> tuple[list[Entry], tuple[str, ...]]:
    """Return an entry for each request in order of arrival, and notes on the bag.

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
    if request.response is None:
        return Entry(name, task, status="no answer", words=missing)
    return entry_of_answer(name, task, request.response, missing)
