"""Decodes messages by the definitions that the bag itself carries."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ff_planner_ros.common.shown import LONGEST_VALUE, printable, quoted
from ff_planner_ros.errors import BagError

Decoder = Callable[[bytes], Any]
ENCODINGS = ("ros2msg", "ros2idl")  # of definitions, in the words of MCAP

_TYPE_NAME = re.compile(r"[A-Za-z]\w*/([a-z]+/)?[A-Za-z]\w*")  # it becomes the name of a class
# Other systems end lines with CR LF or with CR, which the parser takes for characters of a line.
_LINE_END = re.compile(r"\r\n?")
# What the parser says: the whole text in one line, where it stopped, and the text from there on.
_UNPARSED = re.compile(r"Could not parse:\n.*\n\d+\n(?P<rest>.*)", re.DOTALL)
_IDL_HEADING = re.compile(r"={80}\nIDL: \S*\n")
# Nothing is decoded by them, and rosbags reads each for milliseconds.
_IDL_CONSTANTS = re.compile(r"module \w+_Constants \{\n[^{}]*\};\n")
_LONGEST = 64_000  # [bytes] of a definition that is read; ours have 23,000
_MOST_FIELDS = 10_000  # of a message, those within fields counted; ours have 200


@lru_cache(maxsize=64)  # every file of a split bag carries the same definitions
def decoder(name: str, encoding: str, definition: bytes) -> Decoder:
    """Return a function that decodes CDR into objects with the fields of a definition.

    Args:
        name: Name of the message type.
        encoding: Encoding of the definition, one of `ENCODINGS`.

    Raises:
        BagError: The definition cannot be understood. The decoder raises it, too, for bytes that do
            not fit the definition.
    """
    if not _TYPE_NAME.fullmatch(name):
        raise BagError(f"{name!a} is no name of a message type")
    if len(definition) > _LONGEST:
        raise BagError(f"its definition is longer than {_LONGEST} bytes")
    text = _LINE_END.sub("\n", definition.decode(errors="replace"))
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
        _require_moderate(types)
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        wanted = name if name in store.fielddefs else name.replace("/", "/msg/", 1)
        store.get_msgdef(wanted)
    except BagError:
        raise
    except Exception as error:  # the parser has no one error for all that a text can be
        raise BagError(f"its definition cannot be read: {_what_is_wrong(error)}") from None

    def decode(cdr: bytes) -> Any:
        try:
            return store.deserialize_cdr(cdr, wanted)
        except Exception as error:
            raise BagError(f"a message does not fit its definition: {error}") from None

    return decode


def _what_is_wrong(error: Exception) -> str:
    """Return in words what is wrong with a definition that the parser gave up."""
    if isinstance(error, KeyError):
        return f"it holds the type {error.args[0]!a}, and does not define it"
    if isinstance(error, RecursionError):
        return "a type contains itself"
    found = _UNPARSED.match(str(error))
    if found is None:
        return printable(str(error), LONGEST_VALUE) or "it is no definition of a message"
    line = found["rest"].partition("\n")[0].strip()
    return f"{quoted(line)} is not understood" if line else "it is no definition of a message"


def _require_moderate(types: Mapping[str, Any]) -> None:
    """Refuse types with so many fields that a decoder would not come to an end.

    Raises:
        BagError: A type has too many fields.
        Exception: A type contains itself, or a type that is not defined.
    """
    sizes: dict[str, int] = {}
    for name in types:
        if _size(types, name, sizes) > _MOST_FIELDS:
            raise BagError(f"its definition holds more than {_MOST_FIELDS} fields")


def _size(types: Mapping[str, Any], name: str, sizes: dict[str, int]) -> int:
    """Return how many fields a type holds; an array of numbers, which is read at once, is one."""
    if name not in sizes:
        _, held = types[name]
        sizes[name] = sum(_field_size(types, description, sizes) for _, description in held)
    return sizes[name]


def _field_size(types: Mapping[str, Any], description: Any, sizes: dict[str, int]) -> int:
    node, what = description
    if node == Nodetype.NAME:
        return _size(types, what, sizes)
    if node == Nodetype.BASE:
        return 1
    element, length = what
    is_of_numbers = element[0] == Nodetype.BASE and element[1][0] not in ("string", "wstring")
    times = length if node == Nodetype.ARRAY and not is_of_numbers else 1
    return int(times) * _field_size(types, element, sizes)


@lru_cache(maxsize=256)  # the events of a service and of its action hold the same types
def _types_in_idl(section: str) -> Any:
    return get_types_from_idl(_IDL_CONSTANTS.sub("", section))
