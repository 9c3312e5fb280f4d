"""Target bodies from ROS messages."""

from __future__ import annotations

from typing import Any

from ff_planner_ros.common.declared_messages import names_in, values_in
from ff_planner_ros.errors import fields_named
from ff_planner_ros.messages.obstacles import attached_bodies_of, require_zero
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.target_body import AttachedSphereEntry, TargetBody
from ff_planner_ros.planning.scenario.body_file import with_urdf

FIELD = "target_body"  # as topic and field of a request are called
NAMED_AS = names_in(TargetBody, FIELD, FIELD)  # fields of the message, by those of a scenario
_FIXED = "the sphere is fixed to the body"


def captures(request: Any) -> bool:
    """Return whether any phase of a request captures the target body."""
    return any(one.goal.kind == GoalKind.CAPTURE for one in (request, *request.then))


def target_body_in(message: Any) -> TargetBody:
    """Return the target body of a message, at the message's stamp.

    Raises:
        InvalidInput: A field is invalid; the error names it below `target_body`.
    """
    require_zero(message, "inertia.com", "the frame is at the centre of mass", FIELD)
    names = dict(NAMED_AS)
    for index, sphere in enumerate(message.obstacles):
        place = f"{FIELD}.obstacles[{index}]"
        require_zero(sphere, "twist.linear", _FIXED, place)
        require_zero(sphere, "twist.angular", _FIXED, place)
        names |= names_in(AttachedSphereEntry, f"{FIELD}.obstacles[{sphere.id}]", place)
    bodies = attached_bodies_of(message, FIELD)
    with fields_named(names):
        given = values_in(TargetBody, message, FIELD)
        given["obstacles"] = (*given.get("obstacles", ()), *bodies)
        if message.urdf:
            # Its inertia counts where the message has none.
            if not given["inertia"].any():
                del given["inertia"]
            # It comes from elsewhere, and names no file of this machine.
            given = with_urdf(given, message.urdf, f"{FIELD}.urdf")
        return TargetBody(**given)
