"""A planner that assumes an immovable chaser; its joint motion is executed by the true system."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ff_planner_benchmark.entrants.planned import answer_of
from ff_planner_ros.baselines.beliefs import fixed_base


def answer(scenario: Path, _seconds: float) -> dict[str, Any]:
    """Plan for an immovable chaser."""
    return answer_of(scenario, fixed_base)
