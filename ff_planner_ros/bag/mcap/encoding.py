"""ROS messages as bytes: CDR of exact length."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
    NamespacedType,
)

from ff_planner_ros.errors import BagError

# Why not a library: rclpy's `serialize_message` over-estimates the length and leaves padding
# uninitialised, which strict readers reject; mcap-ros2-support encodes only while writing a file
# of its own and refuses numpy arrays (every covariance, every client_gid) and `byte` fields.
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_FORMATS = {
    "boolean": "<?",
    "int8": "<b",
    "uint8": "<B",
    "int16": "<h",
    "uint16": "<H",
    "int32": "<i",
    "uint32": "<I",
    "int64": "<q",
    "uint64": "<Q",
    "float": "<f",
    "double": "<d",
}


def encode(message: Any) -> bytes:
    """Return any rclpy message as CDR: little-endian, exact length, padding zero.

    Raises:
        BagError: A field has a type that is not supported (`wstring`).
    """
    body = bytearray()
    _put_members(body, message)
    return _LITTLE_ENDIAN + bytes(body)


def _put_members(body: bytearray, message: Any) -> None:
    fields = message.get_fields_and_field_types()
    if not fields:
        body.append(0)  # IDL has no empty structure: rosidl adds one dummy octet
    for name, slot_type in zip(fields, message.SLOT_TYPES, strict=True):
        _put(body, slot_type, getattr(message, name))


def _put(body: bytearray, slot_type: Any, value: Any) -> None:
    match slot_type:
        case NamespacedType():
            _put_members(body, value)
        case BasicType(typename="octet"):
            body += value
        case BasicType():
            _put_number(body, _FORMATS[slot_type.typename], value)
        case AbstractString():
            text = value.encode() + b"\0"
            _put_number(body, "<I", len(text))
            body += text
        case AbstractNestedType():
            if not isinstance(slot_type, Array):
                _put_number(body, "<I", len(value))
            _put_elements(body, slot_type.value_type, value)
        case _:
            raise BagError(f"a field of type {type(slot_type).__name__} cannot be recorded")


def _put_elements(body: bytearray, element_type: Any, values: Any) -> None:
    if isinstance(element_type, BasicType) and element_type.typename != "octet":
        if len(values) > 0:  # an empty sequence is not aligned
            array = np.asarray(values, dtype=_FORMATS[element_type.typename])
            _align(body, array.itemsize)
            body += array.tobytes()
        return
    for value in values:
        _put(body, element_type, value)


def _put_number(body: bytearray, number_format: str, value: float) -> None:
    _align(body, struct.calcsize(number_format))
    body += struct.pack(number_format, value)


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)
