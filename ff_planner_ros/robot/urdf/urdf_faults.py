"""The faults of a URDF, collected so that one error reports all of them."""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Iterable
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ff_planner_ros.common.shown import printable
from ff_planner_ros.errors import InvalidInput, Status

# Nothing in space is heavier [kg], longer [m] or stronger [N m], and squares stay finite.
LARGEST = 1e12

_LONGEST_TEXT = 850  # characters of all faults together: a message has at most 1,000
_LONGEST_LIST = 400  # characters of a list of names in a fault
LONGEST_NOTE = 4000  # characters of a list in a note: a humanoid's locked joints
_LONGEST_WORD = 200  # characters of one value; longer names are refused
_LONGEST_NUMBERS = 1000  # characters that three numbers may take


class InertiaChoice(enum.StrEnum):
    """What happens to an inertia that no body has."""

    POSSIBLE = "possible"  # it is refused
    AS_GIVEN = "as_given"  # it counts as written: a body that moves needs positive moments alone
    NEAREST = "nearest_possible"  # the nearest one that a body has counts instead


class Fault(NamedTuple):
    """A fault in a URDF or its parameters."""

    kind: str  # of element, or parameter at fault: `joint`, `robot.tip_link`
    name: str  # of the element; empty: it has none
    part: str  # of the element: `limit velocity`; empty: the element itself
    value: str
    allowed: str
    line: int = 0  # of the file; 0: not known

    @property
    def field(self) -> str:
        """Kind, name and part at fault, as one text for errors."""
        name = repr(shortened(self.name)) if self.name else ""
        return " ".join(word for word in (self.kind, name, self.part) if word)

    @property
    def where(self) -> str:
        """The line as a text to append; empty: it is not known."""
        return f" (line {self.line})" if self.line else ""


class Faults:
    """The faults found so far."""

    def __init__(self) -> None:
        """Start without any fault."""
        self._found: list[Fault] = []
        # Elements that know their line, by kind and name
        self.places: dict[tuple[str, str], Element] = {}
        self.unread: dict[str, None] = {}  # elements and attributes that a note names, once each

    @property
    def notes(self) -> list[str]:
        """Notes for the user, on what is no fault."""
        return [f"not read: {listed(self.unread)}"] if self.unread else []

    def add(
        self,
        kind: str,
        name: str,
        part: str,
        value: object,
        allowed: str,
        at: Element | int | None = None,
    ) -> None:
        """Add a fault; the other arguments are those of `Fault`.

        Args:
            at: Element at fault, or its line. None: that of this kind and name, or its part.
        """
        line = at if isinstance(at, int) else line_of(at) or self._line_of(kind, name, part)
        self._found.append(Fault(kind, name, part, str(value), allowed, line))

    def _line_of(self, kind: str, name: str, part: str) -> int:
        found = self.places.get((kind, name))
        for word in part.split():
            inside = [] if found is None else [one for one in found.iter(word) if one is not found]
            if len(inside) != 1:
                break
            found = inside[0]
        return line_of(found)

    def __len__(self) -> int:
        """Return the number of faults."""
        return len(self._found)

    def refuse_if_any(self) -> None:
        """Raise one error for all faults.

        Raises:
            InvalidInput: There are faults.
        """
        if len(self._found) == 1:
            (only,) = self._found
            raise InvalidInput(Status.BAD_ROBOT, only.field, only.value, only.allowed + only.where)
        if self._found:
            count = f"at fault in {len(self._found)} places"
            raise InvalidInput(Status.BAD_ROBOT, "robot.urdf", count, _told(self._found))

    def number(self, kind: str, name: str, part: str, element: Element | None, key: str) -> float:
        """Return an attribute's number, NaN if it is faulty, and write it back as it was read."""
        text = None if element is None else element.get(key)
        if element is None or text is None:
            self.add(kind, name, part, "missing", "it must be a number", element)
            return math.nan
        numbers = finite_numbers(text)
        if len(numbers) != 1:
            self.add(kind, name, part, repr(shortened(text)), "it must be a finite number", element)
            return math.nan
        if abs(numbers[0]) > LARGEST:
            self.add(kind, name, part, numbers[0], f"its size must be at most {LARGEST:g}", element)
            return math.nan
        element.set(key, repr(numbers[0]))
        return numbers[0]

    def vectors(self, kind: str, name: str, part: str, element: Element | None) -> bool:
        """Rewrite `xyz` and `rpy` of an element as they were read; tell whether they are sound."""
        told = len(self)
        if element is None:
            return True
        for key, text in element.items():
            numbers = finite_numbers(text)
            if key == "quat_xyzw":
                self.add(kind, name, part, "a quaternion", "write it as rpy", element)
            elif len(numbers) != 3:
                value, allowed = repr(shortened(text)), "it must be three finite numbers"
                self.add(kind, name, f"{part} {key}", value, allowed, element)
            elif max(map(abs, numbers)) > LARGEST:
                allowed = f"their size must be at most {LARGEST:g}"
                self.add(kind, name, f"{part} {key}", shortened(text), allowed, element)
            else:
                element.set(key, " ".join(map(repr, numbers)))
        return len(self) == told


def line_of(element: Element | None) -> int:
    """Return the line on which an element of a file begins; 0: it is not known."""
    return getattr(element, "line", 0)


def listed(names: Iterable[str], longest: int = _LONGEST_LIST) -> str:
    """Return names with commas between; of many the first ones, and how many more there are."""
    every = [shortened(name) for name in names]
    ends = itertools.accumulate(len(name) + len(", ") for name in every)
    fit = max(1, sum(end - len(", ") <= longest for end in ends))
    more = f" and {len(every) - fit} more" if len(every) > fit else ""
    return ", ".join(every[:fit]) + more


def shortened(text: str) -> str:
    """Return a name or value, printable, of a very long one the beginning and the end."""
    return printable(text, _LONGEST_WORD)


def finite_numbers(text: str) -> list[float]:
    """Return the numbers of a text; none if one of its words is no finite number."""
    if len(text) > _LONGEST_NUMBERS:
        return []
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def _told(faults: list[Fault]) -> str:
    """Return all faults as one text: those of one kind together, as many names and lines as fit."""
    alike: dict[tuple[str, str, str], list[Fault]] = {}
    for fault in faults:
        alike.setdefault((fault.kind, fault.part, fault.allowed), []).append(fault)
    kinds = list[str]()
    for names, lines in itertools.product((len(faults), 20, 10, 5, 2, 1), (len(faults), 1, 0)):
        kinds = [_of_one_kind(group, names, lines) for group in alike.values()]
        text = "; ".join(kinds)
        if len(text) <= _LONGEST_TEXT:
            return text
    ends = itertools.accumulate(len(kind) + len("; ") for kind in kinds)
    fit = max(1, sum(end <= _LONGEST_TEXT for end in ends))
    return f"{'; '.join(kinds[:fit])}; {len(kinds) - fit} more kinds of faults"


def _of_one_kind(faults: list[Fault], names_at_most: int, lines_at_most: int) -> str:
    first, *others = faults
    lines = [fault.line if number < lines_at_most else 0 for number, fault in enumerate(faults)]
    named = [repr(shortened(fault.name)) if fault.name else "" for fault in others]
    also = [
        (name + (f" on {line}" if line else "")).strip()
        for name, line in zip(named[: names_at_most - 1], lines[1:], strict=False)
    ]
    also = [one for one in also if one]
    left_out = len(others) - len(also)
    also = [", ".join(also)] * bool(also) + [f"{left_out} more"] * bool(left_out)
    told = [f"line {lines[0]}"] * bool(lines[0]) + [f"likewise {' and '.join(also)}"] * bool(also)
    text = f"{first.field} is {shortened(first.value)}: {first.allowed}"
    return f"{text} ({'; '.join(told)})" if told else text
