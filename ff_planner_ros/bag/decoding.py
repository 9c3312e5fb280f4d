"""Messages from bytes, by the definition that the bag itself carries."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ff_planner_ros.errors import BagError

Decoder = Callable[[bytes], Any]
NANOSECONDS = 1_000_000_000  # in a second
ENCODINGS = ("ros2msg", "ros2idl")  # of definitions, in the words of MCAP

_TYPE_NAME = re.compile(r"[A-Za-z]\w*/([a-z]+/)?[A-Za-z]\w*")  # it becomes the name of a class
_IDL_HEADING = re.compile(r"={80}\nIDL: \S*\n")
# Nothing is decoded by them, and rosbags reads each for milliseconds.
_IDL_CONSTANTS = re.compile(r"module \w+_Constants \{\n[^{}]*\};\n")
_LONGEST = 64_000  # [bytes] of a definition that is read; ours have 23,000


def nanoseconds(stamp: Any) -> int:
    """Return a message's time or duration as integer nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


@lru_cache(maxsize=64)  # every file of a split bag carries the same definitions
def decoder(name: str, encoding: str, definition: bytes) -> Decoder:
    """Return what turns CDR into plain objects with the fields of the recorded definition.

    Raises:
        BagError: The definition cannot be understood. The decoder itself raises it where the
            bytes do not fit the definition.
    """
    if not _TYPE_NAME.fullmatch(name):
        raise BagError(f"{name!a} is no name of a message type")
    if len(definition) > _LONGEST:
        raise BagError(f"its definition is longer than {_LONGEST} bytes")
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
