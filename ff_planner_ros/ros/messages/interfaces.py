"""Names of the planner's interfaces, and lookup of message classes by their names."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any

from rosidl_parser.definition import NamespacedType

SERVICE, ACTION = "plan_trajectory", "plan_trajectory_action"
PUBLISH_PLAN, DESCRIBE = "~/publish_plan", "~/describe"
EXCHANGES, ROBOT_MODEL = "exchanges", "robot_model"


def type_name(message_type: type) -> str:
    """Return the name of a message class as a bag writes it, `package/msg/Name`."""
    package, kind = message_type.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_type.__name__}"


def class_of(element: NamespacedType, owner: Any) -> Any:
    """Return the class of a field's type; `owner` is the class of the message with the field."""
    # What ROS itself makes of an action is in the module of the action only.
    beside = getattr(sys.modules[owner.__module__], element.name, None)
    return beside or getattr(import_module(".".join(element.namespaces)), element.name)


def entry_of(message: Any, array: str) -> Any:
    """Return a new, empty element for the array field `array` of a message."""
    kinds = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
    return class_of(kinds[array].value_type, type(message))()
