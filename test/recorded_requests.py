"""Requests with their answers and tasks, in bags and as they are read out of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ff_planner_msgs.msg import PlanAnswer, PlanRequest

from ff_planner_ros.bag.exchanges import Exchange, exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.runs.planned_motions import PlannedMotion, recorded_motions
from ff_planner_ros.runs.replay import Replayed, replay


def only_request(bag: Path) -> Exchange:
    """Return the request of a bag that has one."""
    with open_bag(bag) as opened:
        (recorded,) = exchanges(opened)
    return recorded


def replays_of(bag: Path) -> dict[str, Replayed]:
    """Replay a bag, and return what became of each request by its plan id."""
    with open_bag(bag) as opened:
        return {one.plan_id: replay(one) for one in exchanges(opened)}


def recorded(
    task: PlanningTask | None, answer: PlanAnswer | None, plan_id: str = "run.1", **changes: Any
) -> Exchange:
    """Return a request of a service as a bag gives it back."""
    told = {
        "planner": "",
        "topic": "/exchanges",
        "plan_id": plan_id,
        "interface": "service",
        "requester": "",
        "event": "received" if answer is None else "answered",
        "logged_ns": 0,
        "request": PlanRequest(),
        "answer": answer,
        "task": "" if task is None else task_json(task),
        "versions": "{}",
        "urdfs": (),
    }
    return Exchange(**told | changes)


def motions_in(bag: Path) -> list[PlannedMotion]:
    """Return the plans of a bag as `ff-planner verify` executes them."""
    return list(recorded_motions(bag, lambda _: None))
