"""The planner of this package, with its default settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ff_planner_benchmark.entrants.planned import answer_of
from ff_planner_ros.planning.task.task import PlanningTask, perform


def answer(scenario: Path, _seconds: float) -> dict[str, Any]:
    """Plan; the planner stops by its iteration limits, never by time."""
    return answer_of(scenario, lambda problem, settings: perform(PlanningTask(problem, settings)))
