"""A planner that assumes zero total momentum; its joint motion is executed by the true system."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ff_planner_benchmark.entrants.planned import answer_of
from ff_planner_ros.baselines.beliefs import zero_momentum


def answer(scenario: Path, _seconds: float) -> dict[str, Any]:
    """Plan for zero total momentum."""
    return answer_of(scenario, zero_momentum)
