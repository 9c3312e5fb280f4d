"""The XML of a URDF, read safely from any text, and reduced to the elements that are used."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection
from typing import Any, NoReturn
from xml.etree.ElementTree import Element, SubElement, TreeBuilder
from xml.parsers import expat

from ff_planner_ros.errors import InvalidInput, Status

# Twenty times the largest robots that ROS users share; such a text is read in a second.
MAX_CHARACTERS = 4_000_000

# A humanoid with both hands has two hundred. The time to build a model grows with the square.
MAX_LINKS = 1000

# Element of a recorded URDF: where a joint is locked that is a fixed one there.
LOCKED = "locked"
# Elements that are read, by their parents; all others are ignored: a missing mesh shall not stop a
# plan.
_PARTS: dict[str, Any] = {
    "link": {"inertial": {"origin": {}, "mass": {}, "inertia": {}}},
    "joint": {key: {} for key in ("origin", "parent", "child", "axis", "limit", "mimic", LOCKED)},
}
# The same for the shapes of links; a link may have several of these.
_GEOMETRY: dict[str, Any] = {
    "box": {},
    "capsule": {},
    "cone": {},
    "cylinder": {},
    "mesh": {},
    "sphere": {},
}
_SHAPES: dict[str, Any] = {
    "link": {name: {"origin": {}, "geometry": _GEOMETRY} for name in ("visual", "collision")}
}
# Elements of an SRDF, also in a recorded URDF: pairs of links that may touch, links that may touch
# any other, and pairs that may not nevertheless.
DISABLE, DISABLE_ALL = "disable_collisions", "disable_default_collisions"
ENABLE = "enable_collisions"
_COLLISIONS: dict[str, Any] = {DISABLE: {}, DISABLE_ALL: {}, ENABLE: {}}
_MOST_DISABLED = 100_000  # a humanoid's SRDF has two thousand
_SEVERAL, _MOST_OF_THEM = tuple(_SHAPES["link"]), 10_000
_ATTRIBUTES = {
    "link": ("name",),
    "joint": ("name", "type"),
    "inertial": (),
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "mass": ("value",),
    "inertia": ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort"),
    "mimic": ("joint", "multiplier", "offset"),
    LOCKED: ("type", "position"),
    "visual": (),
    "collision": (),
    "geometry": (),
    "box": ("size",),
    "capsule": ("radius", "length"),
    "cone": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "mesh": ("filename", "scale"),
    "sphere": ("radius",),
    DISABLE: ("link1", "link2", "reason"),
    DISABLE_ALL: ("link",),
    ENABLE: ("link1", "link2"),
}


def read_elements(text: str) -> Element:
    """Return the `<robot>` with its links and joints, without shapes and simulator tags.

    Raises:
        InvalidInput: The text is no XML, another document, too large, or declares entities, say.
    """
    _require_short(text)
    return _read(text, _PARTS)


def read_shapes(text: str) -> Element:
    """Return the `<robot>` of a text that `read_elements` accepts, with the shapes of its links.

    Raises:
        InvalidInput: As for `read_elements`.
    """
    return _read(text, _SHAPES)


def read_collisions(text: str, field: str) -> list[Element]:
    """Return the elements of an SRDF, or of a recorded URDF, on links that may touch.

    Raises:
        InvalidInput: As for `read_elements`; the error names `field`.
    """
    try:
        _require_short(text)
        return list(_read(text, _COLLISIONS, _MOST_DISABLED))
    except InvalidInput as error:
        raise InvalidInput(error.status, field, error.value, error.allowed) from None


def read_tags(text: str, tags: Collection[str]) -> Element:
    """Return the `<robot>` of a text that `read_elements` accepts, with some of its elements.

    Args:
        tags: Of these elements; one in an element of another tag is left out with it.
    """
    builder, passed_over = TreeBuilder(), 0  # elements open, the innermost ones

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal passed_over
        if passed_over or tag not in tags:
            passed_over += 1
        else:
            builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal passed_over
        if passed_over:
            passed_over -= 1
        else:
            builder.end(tag)

    def characters(data: str) -> None:
        if not passed_over:
            builder.data(data)

    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = characters
    parser.Parse(text, True)
    return builder.close()


def _require_short(text: str) -> None:
    if len(text) > MAX_CHARACTERS:
        _refuse(f"{len(text)} characters long", f"it must be at most {MAX_CHARACTERS}")


def _read(text: str, parts: dict[str, Any], most: int = 2 * MAX_LINKS) -> Element:
    reader = _Reader(parts, most)
    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.StartDoctypeDeclHandler = reader.document_type
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, UnicodeEncodeError) as error:
        _refuse("not XML", str(error)[:200])
    return reader.robot


class _Reader:
    """Builds elements; those that are ignored may be nested to any depth."""

    def __init__(self, parts: dict[str, Any], most: int) -> None:
        self.robot = Element("robot")
        self._most = most  # elements of the robot
        self._of_robot = parts
        self._several = dict.fromkeys(_SEVERAL, 0)  # so far
        self._open: list[Element] = []
        self._parts: list[dict[str, Any]] = []
        self._passed_over = 0  # elements open, the innermost ones

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self._open:
            if tag != "robot":
                _refuse(f"a <{tag[:50]}>", "its outermost tag must be <robot>")
            self.robot.set("name", attributes.get("name") or "robot")
            self._enter(self.robot, self._of_robot)
            return
        parent, parts = self._open[-1], self._parts[-1].get(tag)
        # Of two parts of one kind the first counts, as for every reader of URDFs.
        again = parent is not self.robot and parent.find(tag) is not None
        if tag in _SEVERAL and not self._passed_over and parts is not None:
            self._several[tag] += 1
            again = self._several[tag] > _MOST_OF_THEM
        if self._passed_over or parts is None or again:
            self._passed_over += 1
            return
        if parent is self.robot and len(parent) == self._most:
            most = f"{MAX_LINKS} links and as many joints"
            most = f"{self._most} {DISABLE}" if tag in _COLLISIONS else most
            _refuse("too large", f"it must have at most {most}")
        kept = {key: attributes[key] for key in _ATTRIBUTES[tag] if key in attributes}
        self._enter(SubElement(parent, tag, kept), parts)

    def end(self, _tag: str) -> None:
        if self._passed_over:
            self._passed_over -= 1
        else:
            self._open.pop()
            self._parts.pop()

    def document_type(self, *declaration: Any) -> None:
        # An entity, or an attribute's default, of a few bytes may stand for gigabytes.
        if declaration[-1]:
            _refuse("with declarations in its <!DOCTYPE>", "a URDF must have none")

    def _enter(self, element: Element, parts: dict[str, Any]) -> None:
        self._open.append(element)
        self._parts.append(parts)


def _refuse(value: str, allowed: str) -> NoReturn:
    raise InvalidInput(Status.BAD_ROBOT, "robot.urdf", value, allowed)


def as_revolute(xml: str) -> tuple[str, list[str]]:
    """Return a URDF with continuous joints as revolute ones, and their names.

    Pinocchio has two numbers for the position of a continuous joint.
    """
    robot = ElementTree.fromstring(xml)
    endless = robot.findall("joint[@type='continuous']")
    for joint in endless:
        joint.set("type", "revolute")
    told = ElementTree.tostring(robot, encoding="unicode") if endless else xml
    return told, [joint.get("name", "") for joint in endless]
