"""What a bag has recorded of a request."""

from __future__ import annotations

from pathlib import Path

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.runs.recorded_run import RecordedRequest, recorded_run


def only_request(bag: Path) -> RecordedRequest:
    """Return the request of a bag that has one."""
    with open_bag(bag) as opened:
        (recorded,) = recorded_run(opened).requests
    return recorded
