"""The plans of a campaign as a warm-start library."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ff_planner_ros.campaign.table import read_plans
from ff_planner_ros.planning.scenario.library_file import save_library
from ff_planner_ros.planning.task.library import StoredPlan

_COLUMNS = ["kind", "place", "coefficients"]


def write_library(campaign: Path, directory: Path) -> int:
    """Write a campaign's plans of method `optimal` as a library; return their number.

    Raises:
        InvalidInput: There is no campaign, or a file of it is damaged.
        OSError: The library cannot be written.
    """
    plans = list(_stored(campaign))
    save_library(plans, directory)
    return len(plans)


def _stored(campaign: Path) -> Iterator[StoredPlan]:
    for row in read_plans(campaign).select(_COLUMNS).to_pylist():
        if row["kind"] is not None:
            yield StoredPlan(row["kind"], np.array(row["place"]), np.array(row["coefficients"]))
