"""Messages from bytes, by the definition that the bag itself carries."""

from __future__ import annotations

import array
import re
import sys
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ff_planner_ros.errors import BagError

if TYPE_CHECKING:
    from rosidl_parser.definition import NamespacedType

T = TypeVar("T")
Decoder = Callable[[bytes], Any]
ENCODINGS = ("ros2msg", "ros2idl")  # of definitions, in the words of MCAP

_TYPE_NAME = re.compile(r"[A-Za-z]\w*/([a-z]+/)?[A-Za-z]\w*")  # it becomes the name of a class
_IDL_HEADING = re.compile(r"={80}\nIDL: \S*\n")
# Nothing is decoded by them, and rosbags reads each for milliseconds.
_IDL_CONSTANTS = re.compile(r"module \w+_Constants \{\n.*?\n\s*\};\n", re.DOTALL)


@lru_cache(maxsize=64)  # every file of a split bag carries the same definitions
def decoder(name: str, encoding: str, definition: bytes) -> Decoder:
    """Return what turns CDR into plain objects with the fields of the recorded definition.

    Raises:
        BagError: The definition cannot be understood. The decoder itself raises it where the
            bytes do not fit the definition.
    """
    if not _TYPE_NAME.fullmatch(name):
        raise BagError(f"{name!a} is no name of a message type")
    text = definition.decode(errors="replace")
    try:
        if encoding == "ros2msg":
            types = get_types_from_msg(text, name)
        elif encoding == "ros2idl":
            types = {}
            for section in filter(str.strip, _IDL_HEADING.split(text)):
                types |= _types_in_idl(section)
        else:
            known = " and ".join(ENCODINGS)
            raise BagError(f"its definition is in {encoding!a}; known are {known}")
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        wanted = name if name in store.fielddefs else name.replace("/", "/msg/", 1)
        store.get_msgdef(wanted)
    except BagError:
        raise
    except Exception as error:  # the parser has no one error for all that a text can be
        raise BagError(f"its definition cannot be read: {type(error).__name__}") from None

    def decode(cdr: bytes) -> Any:
        try:
            return store.deserialize_cdr(cdr, wanted)
        except Exception as error:
            raise BagError(f"a message does not fit its definition: {error}") from None

    return decode


@lru_cache(maxsize=256)  # the events of a service and of its action hold the same types
def _types_in_idl(section: str) -> Any:
    return get_types_from_idl(_IDL_CONSTANTS.sub("", section))


def as_installed(decoded: Any, message_class: type[T]) -> T:
    """Copy a decoded message into an installed message class.

    Fields that the recording lacks keep their default; those that are not known here are dropped.

    Args:
        message_class: Of rosidl: a message, or the request, response or event of a service.

    Raises:
        BagError: A field has another type than was recorded.
    """
    kind: Any = message_class
    message: T = kind(check_fields=True)  # otherwise rosidl takes anything for anything
    for name, slot_type in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        if hasattr(decoded, name):
            try:
                value = _value(getattr(decoded, name), getattr(message, name), slot_type, kind)
                setattr(message, name, value)
            except (AssertionError, AttributeError, TypeError, ValueError):
                raise BagError(
                    f"{kind.__name__}.{name} was recorded as another type than is installed here"
                ) from None
    return message


def _value(recorded: Any, default: Any, slot_type: Any, owner: Any) -> Any:
    # Here, because bags are read where no ROS is installed, too.
    from rosidl_parser.definition import AbstractNestedType, NamespacedType

    match slot_type:
        case NamespacedType() if hasattr(recorded, "__msgtype__"):
            return as_installed(recorded, type(default))
        case AbstractNestedType(value_type=NamespacedType() as element):
            element_class = _class_of(element, owner)
            return [as_installed(one, element_class) for one in recorded]
        case AbstractNestedType() if isinstance(default, array.array):
            return array.array(default.typecode, np.asarray(recorded).tolist())
        case AbstractNestedType() if isinstance(default, np.ndarray):
            return np.asarray(recorded, dtype=default.dtype)
        case AbstractNestedType(value_type=element) if _is_octet(element):
            return [_octet(one) for one in recorded]
        case AbstractNestedType():
            return recorded.tolist() if isinstance(recorded, np.ndarray) else list(recorded)
        case _ if _is_octet(slot_type):
            return _octet(recorded)
    return recorded


def _class_of(element: NamespacedType, owner: Any) -> Any:
    # What ROS itself makes of an action is in the module of the action only.
    beside = getattr(sys.modules[owner.__module__], element.name, None)
    return beside or getattr(import_module(".".join(element.namespaces)), element.name)


def _is_octet(slot_type: Any) -> bool:
    return getattr(slot_type, "typename", None) == "octet"


def _octet(number: int) -> bytes:
    return bytes([int(number) & 0xFF])  # rosbags takes it for signed
