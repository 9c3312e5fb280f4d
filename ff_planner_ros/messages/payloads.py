"""Payloads from ROS messages, and robots that hold them."""

from __future__ import annotations

from typing import Any

from ff_planner_ros.common.declared_messages import names_in, values_in
from ff_planner_ros.errors import fields_named
from ff_planner_ros.messages.obstacles import BODIES, require_zero, solid_in
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.payload import FIELD, HeldShape, Payload, with_payload

PAYLOAD = "payload"  # field of a request
# Fields of the message, by those of a scenario.
_NAMES = names_in(Payload, FIELD, PAYLOAD) | {f"{FIELD}.shapes": f"{PAYLOAD}.{BODIES}"}


def robot_holding(robot: Robot, request: Any) -> Robot:
    """Return the robot with the payload that a request brings, if it brings one.

    Raises:
        InvalidInput: The payload is invalid; the error names its field.
    """
    with fields_named(_NAMES):
        payload = payload_in(request)
        return robot if payload is None else with_payload(robot, payload)


def payload_in(request: Any) -> Payload | None:
    """Return the payload of a request or a phase; None without one.

    Raises:
        InvalidInput: The payload is invalid; the error names its field.
    """
    if not request.payload:
        return None
    (message,) = request.payload
    with fields_named(_NAMES):
        bodies = enumerate(message.bodies)
        shapes = tuple(_shape(f"{PAYLOAD}.{BODIES}[{index}]", one) for index, one in bodies)
        return Payload(**values_in(Payload, message, FIELD), shapes=shapes)


def _shape(place: str, message: Any) -> HeldShape:
    for moving in ("twist.linear", "twist.angular"):
        require_zero(message, moving, "what a link holds moves with it", place)
    solid = solid_in(message, place)
    with fields_named(names_in(HeldShape, f"{FIELD}.shapes[{message.id}]", place)):
        return HeldShape(shape=solid, **values_in(HeldShape, message))
