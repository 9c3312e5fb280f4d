"""Decodes messages by the definitions that the bag itself carries."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
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
_LONGEST = 64_000  # [bytes] of a definition that is read; ours have 23,000
_MOST_ELEMENTS = 10_000  # of all arrays of texts or types: the decoder has a line for each


@lru_cache(maxsize=256)  # every file of a split bag carries the same definitions
def decoder(name: str, encoding: str, definition: bytes) -> Decoder:
    """Return a function that decodes CDR into objects with the fields of a definition.

    It raises BagError for bytes that do not fit the definition, and for all where the definition
    cannot be understood.

    Args:
        name: Name of the message type.
        encoding: Encoding of the definition, one of `ENCODINGS`.
    """
    try:
        return _decoder(name, encoding, definition)
    except BagError as error:
        reason = str(error)

    def refuse(_cdr: bytes) -> Any:
        raise BagError(reason)

    return refuse


def _decoder(name: str, encoding: str, definition: bytes) -> Decoder:
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
                types |= get_types_from_idl(section)
        else:
            known = " and ".join(ENCODINGS)
            raise BagError(f"its definition is in {encoding!a}; known are {known}")
        _require_moderate(types.values())
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


def _require_moderate(types: Iterable[Any]) -> None:
    """Refuse types whose decoder would be too long, or would go on where no bytes are left.

    Raises:
        BagError: An array is empty, or there are too many elements in arrays.
    """
    arrays = [what for _, held in types for _, (node, what) in held if node == Nodetype.ARRAY]
    if any(length < 1 for _, length in arrays):
        raise BagError("its definition holds an array of no elements")
    # An array of numbers is read at once.
    lengths = (
        length
        for (node, what), length in arrays
        if node != Nodetype.BASE or what[0] in ("string", "wstring")
    )
    if sum(lengths) > _MOST_ELEMENTS:
        raise BagError(f"its definition holds arrays of more than {_MOST_ELEMENTS} elements")
