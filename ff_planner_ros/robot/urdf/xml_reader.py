"""The one reader of XML: by a table of elements, safe with any text, and with the line of each.

What a table does not know and might change poses, inertias, solids or limits is refused, and so is
a second one of what may be there once. A note names what else is not known.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import NoReturn, TypeAlias
from xml.etree.ElementTree import Element
from xml.parsers import expat

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.urdf.urdf_faults import Faults, finite_numbers, listed, shortened

# Twenty times the largest robots that ROS users share; such a text is read in a second.
MAX_CHARACTERS = 4_000_000

# Of all elements with one name in a file; more are passed over. A humanoid's SRDF has two thousand
# pairs of links.
_MOST_ALIKE = 100_000
_MOST_FAULTS = 10_000
# Part of recorded URDFs, attribute that is refused with words of its own, and entries that are
# there already: no fault offers them.
_NOT_OFFERED = frozenset(("locked", "quat_xyzw", "iyx", "izx", "izy"))

# Elements of robots that simulators and controllers extend by parts of their own.
_EXTENDED = frozenset(("link", "joint"))
# As alike as `<orign>` and `<origin>`, `<axes>` and `<axis>`: by the ratio of `difflib`.
_MISSPELT = 0.75
_MOST_EXTENSIONS = 1000  # names of these; no robot has as many

# Elements of xacro's that needed no prefix once.
_XACRO, _OLD_XACRO = "xacro", frozenset(("include", "macro", "property"))
_EXPAND = "run xacro first: xacro FILE > EXPANDED"


class PlacedElement(Element):
    """An element and the line of the text on which it begins."""

    __slots__ = ("line",)
    line: int


@dataclass(frozen=True)
class Tag:
    """What is read of an element."""

    attributes: tuple[str, ...] = ()
    parts: Mapping[str, Tag] = field(default_factory=dict)
    # Parts, and attributes as "@name", that are not read, and what that means for a plan
    unread: Mapping[str, str] = field(default_factory=dict)
    noted: Mapping[str, str] = field(default_factory=dict)  # the same, named in a note
    has_text: bool = False  # its text is its value
    several: bool = False  # its owner may have more than one
    is_quiet: bool = False  # nothing in it is a fault
    means: str = ""  # for a plan, where that is less than one expects

    def within(self, path: str) -> Iterator[tuple[str, Tag]]:
        """Yield the path of this element, which is given, and of all in it, each with its row."""
        yield path, self
        for name, part in self.parts.items():
            yield from part.within(f"{path}/{name}")


@dataclass(frozen=True)
class Format:
    """The elements of a kind of file."""

    root: str
    tag: Tag
    most: int  # elements
    told_most: str
    field: str = "robot.urdf"
    counted: float = 1  # depth below the root down to which elements count for `most`
    # Elements that must not be in one that is passed over because it is not known
    never_within: frozenset[str] = frozenset()
    known: frozenset[str] = frozenset()  # elements that are no mere extension anywhere
    apart: frozenset[str] = frozenset()  # elements that a reading in parts passes over

    @property
    def by_path(self) -> bool:
        """Whether faults name the link or joint that they are in; else the element alone."""
        return self.root == "robot"


Formats: TypeAlias = Mapping[str, Format]  # by the name of their outermost element


def read_xml(
    text: str,
    formats: Formats,
    faults: Faults,
    in_parts: bool = False,
    told_in: str = "",
) -> Element:
    """Return the outermost element of a text, with what the format of this name reads in it.

    Args:
        faults: Collects what is wrong.
        in_parts: The elements that the format reads apart are passed over.
        told_in: Element in which faults are told; empty: all are.

    Raises:
        InvalidInput: The text is no XML, another document, not expanded by xacro, too large, or
            declares entities, say.
    """
    reader = _Reader(formats, faults, in_parts, told_in)
    if len(text) > MAX_CHARACTERS:
        reader.refuse(f"{len(text)} characters long", f"it must be at most {MAX_CHARACTERS}")
    try:
        reader.parser.Parse(text, True)
    except (expat.ExpatError, UnicodeEncodeError) as error:
        reader.refuse("not XML", str(error)[:200], with_line=False)
    return reader.root


class _Reader:
    """Builds elements; those that are passed over may be nested to any depth."""

    def __init__(self, formats: Formats, faults: Faults, in_parts: bool, told_in: str) -> None:
        self._formats, self._faults = formats, faults
        self._in_parts, self._told_in = in_parts, told_in
        self._form = next(iter(formats.values()))  # until the outermost element is known
        self._open: list[tuple[Element, Tag, bool]] = []  # with its row, and whether faults count
        self._passed_over = 0  # elements open, the innermost ones
        self._unknown = ""  # the outermost of those, while nothing but a note is due
        self._alike, self._count = Counter[str](), 0
        self._extensions = set[str]()  # names of unknown elements that are not misspelt
        self._prefixes: tuple[str, ...] = (f"{_XACRO}:",)
        self.root = Element("")
        self.parser = expat.ParserCreate("utf-8")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.StartDoctypeDeclHandler = self._declare

    def refuse(self, value: str, allowed: str, with_line: bool = True) -> NoReturn:
        """Refuse the text at once, for what stands where the parser is."""
        line = self.parser.CurrentLineNumber if with_line and self._open else 0
        where = f" (line {line})" if line else ""
        raise InvalidInput(Status.BAD_ROBOT, self._form.field, value, allowed + where)

    def _declare(self, *declaration: object) -> None:
        # An entity, or an attribute's default, of a few bytes may stand for gigabytes.
        if declaration[-1]:
            self.refuse("with declarations in its <!DOCTYPE>", "it must have none")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._require_expanded(tag, {} if self._passed_over else attributes)
        if self._passed_over:
            self._passed_over += 1
            if self._unknown and tag in self._form.never_within:
                place = f"<{'robot' if self._form.by_path else 'model'}>"
                allowed = f"links and joints must be directly in {place}"
                value = f"unknown, and holds <{tag}>"
                self._add(self._unknown, value, allowed, alone=self._unknown)
                self._unknown = ""
        elif not self._open:
            if tag not in self._formats:
                allowed = f"its outermost tag must be <{next(iter(self._formats))}>"
                self.refuse(f"a <{tag[:50]}>", allowed)
            self._form = self._formats[tag]
            self.root = self._enter(tag, attributes, self._form.tag)
        else:
            self._start_part(tag, attributes)

    def _start_part(self, tag: str, attributes: dict[str, str]) -> None:
        owner, row, _ = self._open[-1]
        part = row.parts.get(tag)
        if part is None or (self._in_parts and tag in self._form.apart):
            if part is None and tag not in row.unread:
                self._tell_unknown(owner, row, tag, attributes)
            self._passed_over = 1
            return
        self._count += len(self._open) <= self._form.counted
        if self._count > self._form.most:
            self.refuse("too large", f"it must have at most {self._form.told_most}", False)
        if self._is_one_too_many(owner, tag, part):
            self._passed_over = 1
        else:
            element = self._enter(tag, attributes, part)
            owner.append(element)
            for name in attributes:
                if name not in part.attributes:
                    self._tell_unknown_attribute(element, part, name)

    def _enter(self, tag: str, attributes: dict[str, str], row: Tag) -> Element:
        kept = {name: attributes[name] for name in row.attributes if name in attributes}
        element = PlacedElement(tag, kept)
        element.line = self.parser.CurrentLineNumber
        is_told = self._open[-1][2] if self._open else not self._told_in
        is_told = (is_told or tag == self._told_in) and not row.is_quiet
        self._open.append((element, row, is_told))
        if tag in ("link", "joint") and len(self._open) <= 3:
            self._faults.places.setdefault((tag, element.get("name", "")), element)
        return element

    def _end(self, _tag: str) -> None:
        if self._passed_over:
            self._passed_over -= 1
            if not self._passed_over:
                self._unknown = ""
            return
        element, _, _ = self._open[-1]
        if element.tag == "geometry" and len(element) > 1 and self._form.by_path:
            allowed = "it must hold one: another needs a <collision> of its own"
            self._add("", f"{len(element)} shapes", allowed)
        self._open.pop()

    def _characters(self, data: str) -> None:
        if not self._open or self._passed_over:
            return
        element, row, _ = self._open[-1]
        if row.has_text:
            element.text = (element.text or "") + data
        elif self._form.by_path and not row.parts and data.strip():
            # Some formats write values as text: a URDF's readers do not see it.
            allowed = f"it must be in attributes: {listed(_offered(row.attributes))}"
            self._add("text", repr(shortened(data.strip())), allowed)

    def _require_expanded(self, tag: str, attributes: dict[str, str]) -> None:
        """Refuse an element that is xacro's, or has attributes or expressions of xacro's."""
        for name, value in attributes.items():
            if name.startswith("xmlns:") and _XACRO in value:
                self._prefixes += (f"{name.removeprefix('xmlns:')}:",)
        found = [f"<{tag}>"] if tag.startswith(self._prefixes) else []
        for name, value in attributes.items():
            if name.startswith(self._prefixes) or "${" in value or "$(" in value:
                found.append(f"{name}={value!r}")
        if len(self._open) == 1 and not self._passed_over and self._form.by_path:
            found += [f"<{tag}>"] if tag in _OLD_XACRO else []
        if found:
            self.refuse(f"with {shortened(found[0])}, which is not expanded", _EXPAND)

    def _is_one_too_many(self, owner: Element, tag: str, part: Tag) -> bool:
        """Tell whether an element is not read, as there are such ones already."""
        self._alike[tag] += 1
        # Shapes are counted at the end of their <geometry>.
        if part.several or owner.tag == "geometry" or owner.find(tag) is None:
            return self._alike[tag] > _MOST_ALIKE
        value = "there twice" + ("" if self._form.by_path else f" in <{owner.tag}>")
        self._add(tag, value, "it must be there once", alone=f"<{tag}>")
        return True

    def _tell_unknown(self, owner: Element, row: Tag, tag: str, attributes: dict[str, str]) -> None:
        told, form = f"<{shortened(tag)}>", self._form
        is_open = owner is self.root or owner.tag in _EXTENDED
        is_known = not (form.by_path and is_open) or self._is_known(owner, tag)
        if tag in row.noted or not is_known or (":" in tag and owner.tag != "geometry"):
            self._unknown = "" if tag in row.noted else told
            if form.by_path or tag in row.noted:
                self._note(f"{told} in <{owner.tag}>")
            return
        offered = listed(_offered(row.parts))
        if not form.by_path:
            allowed = f"of a model, <{owner.tag}> may hold {offered or 'nothing else'}"
            self._add("", f"in <{owner.tag}>", allowed, alone=told)
            return
        places = (number for text in attributes.values() for number in finite_numbers(text))
        if (owner.tag, tag) != ("link", "origin") or any(places):  # as onshape-to-robot writes it
            self._add("", f"with an unknown {told}", f"it may hold {offered or 'no elements'}")

    def _is_known(self, owner: Element, tag: str) -> bool:
        """Tell whether an element is one of a format's, perhaps misspelt, and no extension.

        What is directly in `<robot>` may have any name that is not one of these.
        """
        if owner is self.root or tag in self._form.known:
            return tag in self._form.known
        if tag not in self._extensions and len(self._extensions) < _MOST_EXTENSIONS:
            alike = get_close_matches(tag.lower(), self._form.known, cutoff=_MISSPELT)
            self._extensions |= set() if alike else {tag}
        return tag not in self._extensions

    def _tell_unknown_attribute(self, element: Element, row: Tag, name: str) -> None:
        form, told = self._form, shortened(name)
        always = ("xml", "xmlns", "name") if form.by_path else ("xml", "xmlns")
        if name.partition(":")[0] in always or f"@{name}" in row.unread:
            return
        # A link, say, has none that can be left out: what misses a misspelt one refuses it.
        if f"@{name}" in row.noted or (form.by_path and (":" in name or row.parts)):
            self._note(f"{told} of <{element.tag}>")
        elif ":" not in name:
            allowed = f"it may have {listed(_offered(row.attributes)) or 'no attributes'}"
            self._add("", f"with an unknown {told!r}", allowed, alone=f"<{element.tag}>")

    def _note(self, unread: str) -> None:
        if self._open[-1][2]:
            self._faults.unread[unread] = None

    def _add(self, part: str, value: str, allowed: str, alone: str = "") -> None:
        """Add a fault of the innermost open element that is read, or of a part of it.

        Args:
            alone: What it is of where the format's faults name the element alone.
        """
        if not self._open[-1][2]:
            return
        kind, name, inside = self._form.field, "", [one for one, _, _ in self._open[1:]]
        if alone and not self._form.by_path:
            kind, part, inside = alone, "", []
        elif inside and inside[0].tag in ("link", "joint"):
            owner, *inside = inside
            kind, name = owner.tag, owner.get("name", "")
        words = " ".join(filter(None, (*(one.tag for one in inside), part)))
        self._faults.add(kind, name, words, value, allowed, self.parser.CurrentLineNumber)
        if len(self._faults) >= _MOST_FAULTS:
            self._faults.refuse_if_any()


def _offered(names: Iterable[str]) -> list[str]:
    return [name for name in names if name not in _NOT_OFFERED]
