"""An error as the status message of an answer."""

from __future__ import annotations

from ff_planner_msgs.msg import PlanStatus

from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.messages.status import status_fields


def status_message(error: FfPlannerError) -> PlanStatus:
    """Return an error as a status, with its `status_fields`."""
    return PlanStatus(**status_fields(error))
