"""The target body of a message, as it is or decoded from a bag, as planning has it."""

from __future__ import annotations

from typing import Any

from ff_planner_ros.common.arrays import finite_vector
from ff_planner_ros.common.declared_messages import names_in, require_left_out, value_at, values_in
from ff_planner_ros.errors import InvalidInput, Status, fields_named
from ff_planner_ros.planning.problem.target_body import AttachedSphere, TargetBody

FIELD = "target_body"  # as topic and field of a request are called
NAMED_AS = names_in(TargetBody, FIELD, FIELD)  # fields of the message, by those of a scenario
_FIXED = "the sphere is fixed to the body"


def target_body_in(message: Any) -> TargetBody:
    """Read a target body, at the stamp of its message.

    Raises:
        InvalidInput: It describes no body; the field is named as if the message's were
            `target_body`.
    """
    _require_zero(message, "inertia.com", "the frame is at the centre of mass")
    require_left_out(message, ("bodies", "urdf"), f"{FIELD}.")
    names = dict(NAMED_AS)
    for index, sphere in enumerate(message.obstacles):
        place = f"{FIELD}.obstacles[{index}]"
        _require_zero(sphere, "twist.linear", _FIXED, place)
        _require_zero(sphere, "twist.angular", _FIXED, place)
        names |= names_in(AttachedSphere, f"{FIELD}.obstacles[{sphere.id}]", place)
    with fields_named(names):
        return TargetBody(**values_in(TargetBody, message, FIELD))


def _require_zero(message: Any, path: str, why: str, field: str = FIELD) -> None:
    vector = value_at(message, path)
    numbers = finite_vector(f"{field}.{path}", (vector.x, vector.y, vector.z), 3)
    if numbers.any():
        allowed = f"it must be zero: {why}"
        raise InvalidInput(Status.UNSUPPORTED, f"{field}.{path}", numbers.tolist(), allowed)
