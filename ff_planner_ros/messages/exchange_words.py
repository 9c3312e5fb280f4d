"""Words of `ff_planner_msgs/Exchange`: how a request came, and what became of it."""

from __future__ import annotations

from enum import StrEnum

REFUSED_EARLY = "it was refused before its task was complete"  # why an answer has no task


class Interface(StrEnum):
    """The interface that a request came by."""

    SERVICE = "service"
    ACTION = "action"
    REPLANNING = "replanning"  # either of these, with `replan_active`
    PUBLISH_PLAN = "publish_plan"
    COMMAND_LINE = "command_line"  # of a bag of `ff-planner plan --bag`


class Event(StrEnum):
    """What happened to a request, or to a plan that waits."""

    RECEIVED = "received"
    ANSWERED = "answered"
    CANCELLED = "cancelled"  # answered with CANCELLED
    PUBLISHED = "published"  # the plan that waited
    REJECTED = "rejected"  # likewise
    DROPPED = "dropped"  # the plan that waited will never be published
