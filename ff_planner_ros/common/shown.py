"""Values and texts as messages show them, shortened before they are formatted."""

from __future__ import annotations

import re
import reprlib
from array import array
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from typing import Any

# Of a value in a message: what was received may be a million numbers, and a log line is read.
LONGEST_VALUE = 300
_LONGEST_LINE = 900  # [characters]
_FIRST = 12  # entries of a list that are shown
_MOST_BITS = 10_000  # of a whole number that is written out; Python itself refuses 14,000


# Between such characters are names, numbers and files: half of one would be taken for another.
_BREAK = re.compile(r"[\s,;/]")
_LONGEST_WORD = 60  # [characters]; what is longer is cut all the same


class _Short(reprlib.Repr):
    """Shows the first entries of what is long and the first levels of what is deep."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = _FIRST
        self.maxstring = self.maxother = self.maxlong = LONGEST_VALUE

    def repr_int(self, x: int, level: int) -> str:
        """Show a whole number; of a long one only how long it is."""
        if x.bit_length() > _MOST_BITS:
            return f"a whole number of {x.bit_length()} bits"
        return super().repr_int(x, level)


_SHORT = _Short()


def shown(value: object) -> str:
    """Return a value as `str` does, at most `LONGEST_VALUE` characters and a remark."""
    if isinstance(value, str):
        return shortened(value, LONGEST_VALUE)
    if isinstance(value, array):  # as the numbers of a message are
        value = value[: _FIRST + 1].tolist()
    if isinstance(value, int | list | tuple | dict | set | bytes) and not isinstance(value, bool):
        return quoted(value)
    try:
        return shortened(str(value).replace("\n", ""), LONGEST_VALUE)  # rows of an array
    except Exception:  # whatever an object of a library trips over
        return f"a {type(value).__name__}"


def quoted(value: object) -> str:
    """Return a value as `repr` does, at most `LONGEST_VALUE` characters and a remark."""
    if isinstance(value, str) and len(value) <= LONGEST_VALUE:
        return repr(value)
    return shortened(_SHORT.repr(value).replace("\n", ""), LONGEST_VALUE)


def shortened(text: str, longest: int) -> str:
    """Return a text without its middle, and how long it was, if it is too long.

    A path ends with the name of a file, and a message with what is allowed.
    """
    return text if len(text) <= longest else f"{_ends(text, longest)} ({len(text)} characters)"


def _ends(text: str, longest: int) -> str:
    """Return the beginning and the end of a text, each of whole words."""
    end = longest // 2
    head, tail = text[: longest - end], text[len(text) - end :]
    breaks = [found.start() for found in _BREAK.finditer(head, max(len(head) - _LONGEST_WORD, 1))]
    first = _BREAK.search(tail, 0, _LONGEST_WORD)
    return f"{head[: breaks[-1]] if breaks else head}...{tail[first.start() :] if first else tail}"


def in_a_line(value: Any) -> str:
    """Return the main facts of a dataclass in one line, as its `__repr__`.

    They are the attributes that its class names in `FACTS`, by default its fields, without those
    that have their default value.
    """
    usual = {item.name: _usual(item) for item in fields(value)}
    facts = {name: getattr(value, name) for name in getattr(value, "FACTS", usual)}
    said = [
        f"{name}={_fact(fact)}"
        for name, fact in facts.items()
        if name not in usual or _plain(fact) != _plain(usual[name])
    ]
    one_line = " ".join(", ".join(said).split())  # what a library shows has several
    return shortened(f"{type(value).__name__}({one_line})", LONGEST_VALUE)


def _usual(item: Any) -> object:
    return item.default if item.default_factory is MISSING else item.default_factory()


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def _fact(value: Any) -> str:
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, float):
        return format(value, ".6g")
    if shape := getattr(value, "shape", ()):
        if shape[1:] or shape[0] > _FIRST:
            ends = "" if shape[1:] else f", {_fact(value[0])} to {_fact(value[-1])}"
            return f"{' x '.join(map(str, shape))} numbers{ends}"
        value = value.tolist()
    if isinstance(value, list | tuple):
        entries = [_named(one) or _fact(one) for one in value[:_FIRST]]
        return f"[{', '.join(entries)}{', ...' if len(value) > _FIRST else ''}]"
    return quoted(value)


def _named(value: Any) -> str:
    """Return the id of an obstacle, the class of another dataclass; empty: it is none."""
    return str(getattr(value, "id", type(value).__name__)) if is_dataclass(value) else ""


def in_log(text: str) -> str:
    """Return a text for a log: printable, with all lines but the first indented.

    Names from outside may hold line breaks, and what looks like a line of the log's own.
    """
    return "\n    ".join(printable(line, len(line)) for line in text.splitlines())


def printable(text: str, longest: int = _LONGEST_LINE) -> str:
    """Return a text on one line, without control characters; if too long, without its middle."""
    kept = text if len(text) <= longest else _ends(text, longest)
    if kept.isprintable():
        return kept
    return "".join(character if character.isprintable() else "?" for character in kept)
