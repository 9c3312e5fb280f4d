"""Message classes by their names, and the stamps of serialised messages."""

from __future__ import annotations

import struct
import sys
from importlib import import_module
from typing import Any

from rosidl_parser.definition import NamespacedType

from ff_planner_ros.common.times import NANOSECONDS


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


def header_stamp(cdr: bytes) -> int:
    """Return the header's stamp in a serialised input message [ns]; -1 if it is too short."""
    seconds, nanosec = header_time(cdr)
    return -1 if nanosec < 0 else seconds * NANOSECONDS + nanosec


def header_time(cdr: bytes) -> tuple[int, int]:
    """Return that stamp's seconds and nanoseconds; -1, -1 if the message is too short."""
    if len(cdr) < 12:
        return -1, -1
    seconds, nanosec = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, 4)
    return int(seconds), int(nanosec)
