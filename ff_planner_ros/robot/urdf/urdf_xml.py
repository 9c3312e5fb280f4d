"""The XML of a URDF, read safely from any text, and reduced to the elements that are used.

What is not known and might change poses, inertias, solids or limits is refused, and so is a second
one of what may be there once. A note names what else is not known.
"""

from __future__ import annotations

from typing import Any, NoReturn
from xml.etree.ElementTree import Element, SubElement
from xml.parsers import expat

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.urdf_faults import Faults, finite_numbers, listed, shortened

# Twenty times the largest robots that ROS users share; such a text is read in a second.
MAX_CHARACTERS = 4_000_000

# A humanoid with both hands has two hundred. The time to build a model grows with the square.
MAX_LINKS = 1000

# Element of a recorded URDF: where a joint is locked that is a fixed one there.
LOCKED = "locked"


def _without_effect(*tags: str) -> dict[str, Any]:
    """Return elements of the format, of simulators or of other readers that are passed over."""
    return dict.fromkeys(tags)


# Elements of an SRDF, also in a recorded URDF: pairs of links that may touch, links that may touch
# any other, and pairs that may not nevertheless.
DISABLE, DISABLE_ALL = "disable_collisions", "disable_default_collisions"
ENABLE = "enable_collisions"
_COLLISIONS: dict[str, Any] = {DISABLE: {}, DISABLE_ALL: {}, ENABLE: {}} | _without_effect(
    *("end_effector", "group", "group_state", "joint_property", "link_sphere_approximation"),
    *("gripper", "passive_joint", "rotor_params", "specificities", "virtual_joint"),
)
_MOST_DISABLED = 100_000  # a humanoid's SRDF has two thousand
# Elements that are read, by their parents. Those of shapes are read apart: a missing mesh shall not
# stop a plan.
_INERTIAL: dict[str, Any] = {"origin": {}, "mass": {}, "inertia": {}}
_LINK: dict[str, Any] = {"inertial": _INERTIAL} | _without_effect(
    *("visual", "collision", "collision_checking", "contact", "contact_coefficients", "gazebo"),
    *("gravity", "kinematic", "material", "self_collision_checking", "self_filter", "sensor"),
    *("surface",),
)
_MOTION: dict[str, Any] = {"axis": {}, "limit": {}, "mimic": {}, LOCKED: {}}
_JOINT: dict[str, Any] = {"origin": {}, "parent": {}, "child": {}, **_MOTION} | _without_effect(
    *("actuator", "calibration", "dynamics", "gazebo", "hardware", "safety_controller", "sensor"),
    *("transmission",),
)
_PARTS: dict[str, Any] = {"link": _LINK, "joint": _JOINT} | _without_effect(
    *("gazebo", "material", "ros2_control", "sensor", "transmission"),
    *(DISABLE, DISABLE_ALL, ENABLE),
)
# The same for the shapes of links; a link may have several of these.
_GEOMETRY: dict[str, Any] = {name: {} for name in sorted((*PRIMITIVES, "mesh"))}
_SHAPE: dict[str, Any] = {"origin": {}, "geometry": _GEOMETRY} | _without_effect(
    *("compliant_contact", "contact", "contact_coefficients", "laser_retro", "material"),
    *("max_contacts", "surface", "verbose"),
)
_SHAPES: dict[str, Any] = {"link": {"visual": _SHAPE, "collision": _SHAPE}}
_REFUSED = "quat_xyzw"  # by what reads an origin
_SEVERAL, _MOST_OF_THEM = tuple(_SHAPES["link"]), 10_000
_ATTRIBUTES = {
    "link": ("name",),
    "joint": ("name", "type"),
    "inertial": (),
    "origin": ("xyz", "rpy", _REFUSED),
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
    **{name: tuple(one.sizes) for name, one in PRIMITIVES.items()},
    "mesh": ("filename", "scale"),
    DISABLE: ("link1", "link2", "reason"),
    DISABLE_ALL: ("link",),
    ENABLE: ("link1", "link2"),
}
# Of a <limit>: plans do not keep them.
_OTHER_LIMITS = frozenset(
    ("acceleration", "command_effort", "current", "deceleration", "gear_velocity", "jerk")
)
# What holds such an element is no mere extension.
_OF_ROBOTS = frozenset(("link", "joint", "inertial", "collision", "child"))
# Elements of xacro's that needed no prefix once.
_XACRO, _OLD_XACRO = "xacro", frozenset(("include", "macro", "property"))
_EXPAND = "run xacro first: xacro FILE > EXPANDED"
_URDF = "robot.urdf"
_MOST_FAULTS = 10_000


def read_elements(text: str, faults: Faults) -> Element:
    """Return the `<robot>` with its links and joints, without shapes and simulator tags.

    Raises:
        InvalidInput: The text is no XML, another document, a xacro file, too large, or declares
            entities, say.
    """
    _require_short(text)
    return _read(text, _Reader(_PARTS, faults, "robot"))


def read_shapes(text: str, faults: Faults | None = None) -> Element:
    """Return the `<robot>` of a text that `read_elements` accepts, with the shapes of its links.

    Args:
        faults: Collects what is wrong in `<collision>` elements.

    Raises:
        InvalidInput: As for `read_elements`.
    """
    _require_short(text)
    return _read(text, _Reader(_SHAPES, Faults() if faults is None else faults, "collision"))


def read_collisions(text: str, field: str, faults: Faults) -> Element:
    """Return the `<robot>` with its elements on links that may touch.

    Args:
        field: Of the text: that of an SRDF, or of a recorded URDF, which has other elements, too.

    Raises:
        InvalidInput: As for `read_elements`; the error names `field`.
    """
    told_in = "" if field == _URDF else "robot"
    try:
        _require_short(text)
        return _read(text, _Reader(_COLLISIONS, faults, told_in, _MOST_DISABLED, field))
    except InvalidInput as error:
        raise InvalidInput(error.status, field, error.value, error.allowed) from None


class Expanded:
    """What xacro has expanded: none of its elements, attributes or expressions is left."""

    def __init__(self) -> None:
        """Know xacro's usual prefix."""
        self._prefixes = [f"{_XACRO}:"]

    def require(self, tag: str, attributes: dict[str, str]) -> None:
        """Refuse an element that is xacro's, or has attributes or expressions of xacro's.

        Raises:
            InvalidInput: It is one.
        """
        for name, value in attributes.items():
            if name.startswith("xmlns:") and _XACRO in value:
                self._prefixes.append(f"{name.removeprefix('xmlns:')}:")
        prefixes = tuple(self._prefixes)
        found = [f"<{tag}>"] if tag.startswith(prefixes) else []
        for name, value in attributes.items():
            if name.startswith(prefixes) or "${" in value or "$(" in value:
                found.append(f"{name}={value!r}")
        if found:
            _refuse(f"with {shortened(found[0])}, which is not expanded", _EXPAND)


def parser_for(reader: Any) -> expat.XMLParserType:
    """Return a parser that calls `start`, `end` and `characters` of a reader."""
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.CharacterDataHandler = reader.characters
    parser.StartDoctypeDeclHandler = _refuse_declarations
    return parser


def _refuse_declarations(*declaration: Any) -> None:
    # An entity, or an attribute's default, of a few bytes may stand for gigabytes.
    if declaration[-1]:
        _refuse("with declarations in its <!DOCTYPE>", "it must have none")


def _require_short(text: str) -> None:
    if len(text) > MAX_CHARACTERS:
        _refuse(f"{len(text)} characters long", f"it must be at most {MAX_CHARACTERS}")


def _read(text: str, reader: _Reader) -> Element:
    try:
        parser_for(reader).Parse(text, True)
    except (expat.ExpatError, UnicodeEncodeError) as error:
        _refuse("not XML", str(error)[:200])
    return reader.robot


class _Reader:
    """Builds elements; those that are passed over may be nested to any depth."""

    def __init__(
        self,
        parts: dict[str, Any],
        faults: Faults,
        told_in: str,
        most: int = 2 * MAX_LINKS,
        field: str = "",
    ) -> None:
        self.robot = Element("robot")
        self._most = most  # elements of the robot
        self._of_robot = parts
        self._faults = faults
        self._told_in = told_in  # element whose parts are told if they are not known
        self._field = field  # of faults; empty: they are of a link or joint
        self._several = dict.fromkeys(_SEVERAL, 0)  # so far
        self._open: list[Element] = []
        self._parts: list[dict[str, Any]] = []
        self._passed_over = 0  # elements open, the innermost ones
        self._unknown = ""  # the outermost of those, while nothing but a note is due
        self._expanded = Expanded()

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if self._passed_over:
            self._expanded.require(tag, {})
            self._passed_over += 1
            if self._unknown and tag in _OF_ROBOTS and not self._field:
                allowed = "links and joints must be directly in <robot>"
                self._add(self._unknown, f"unknown, and holds <{tag}>", allowed)
                self._unknown = ""
            return
        self._expanded.require(tag, attributes)
        if not self._open:
            if tag != "robot":
                _refuse(f"a <{tag[:50]}>", "its outermost tag must be <robot>")
            self.robot.set("name", attributes.get("name") or "robot")
            self._enter(self.robot, self._of_robot)
            return
        parent, parts = self._open[-1], self._parts[-1].get(tag)
        if parts is None or self._is_one_too_many(parent, tag):
            self._passed_over = 1
            if tag not in self._parts[-1]:
                self._tell_unknown(parent, tag, attributes)
            return
        if parent is self.robot and len(parent) == self._most:
            most = f"{MAX_LINKS} links and as many joints"
            most = f"{self._most} {DISABLE}" if tag in _COLLISIONS else most
            _refuse("too large", f"it must have at most {most}")
        kept = {key: attributes[key] for key in _ATTRIBUTES[tag] if key in attributes}
        self._enter(SubElement(parent, tag, kept), parts)
        for name in attributes:
            if name not in kept:
                self._tell_unknown_attribute(name)

    def end(self, _tag: str) -> None:
        if self._passed_over:
            self._passed_over -= 1
            if not self._passed_over:
                self._unknown = ""
            return
        element = self._open[-1]
        if element.tag == "geometry" and len(element) > 1:
            allowed = "it must hold one: another needs a <collision> of its own"
            self._add("", f"{len(element)} shapes", allowed)
        self._open.pop()
        self._parts.pop()

    def characters(self, data: str) -> None:
        # Some formats write values as text: a URDF's readers do not see it.
        if self._open and not self._passed_over and not self._parts[-1] and data.strip():
            keys = listed(_ATTRIBUTES[self._open[-1].tag])
            self._add("text", repr(shortened(data.strip())), f"it must be in attributes: {keys}")

    def _enter(self, element: Element, parts: dict[str, Any]) -> None:
        self._open.append(element)
        self._parts.append(parts)

    def _is_one_too_many(self, parent: Element, tag: str) -> bool:
        """Tell whether an element is not read, as there are such ones already."""
        if tag in _SEVERAL:
            self._several[tag] += 1
            return self._several[tag] > _MOST_OF_THEM
        # Shapes are counted at the end of their <geometry>.
        if parent is self.robot or parent.tag == "geometry" or parent.find(tag) is None:
            return False
        self._add(tag, "there twice", "it must be there once")
        return True

    def _tell_unknown(self, parent: Element, tag: str, attributes: dict[str, str]) -> None:
        if parent is self.robot and tag in _OLD_XACRO:
            _refuse(f"with <{tag}>, which is not expanded", _EXPAND)
        if (parent is self.robot and tag not in _ATTRIBUTES) or (
            ":" in tag and parent.tag != "geometry"
        ):
            self._unknown = f"<{shortened(tag)}>"
            self._note(f"{self._unknown} in <{parent.tag}>")
            return
        places = (number for text in attributes.values() for number in finite_numbers(text))
        if (parent.tag, tag) == ("link", "origin") and not any(places):
            return  # as onshape-to-robot writes it
        parts = self._parts[-1].items()
        known = [part for part, inside in parts if inside is not None and part != LOCKED]
        known += _SEVERAL if parent.tag == "link" else ()
        allowed = f"it may hold {listed(known) or 'no elements'}"
        self._add("", f"with an unknown <{shortened(tag)}>", allowed)

    def _tell_unknown_attribute(self, name: str) -> None:
        tag = self._open[-1].tag
        if name.partition(":")[0] in ("xml", "xmlns", "name"):
            return
        # A link, say, has none that can be left out: what misses a misspelt one refuses it.
        if ":" in name or self._parts[-1] or name in _OTHER_LIMITS:
            self._note(f"{shortened(name)} of <{tag}>")
        else:
            known = (key for key in _ATTRIBUTES[tag] if key != _REFUSED)
            allowed = f"it may have {listed(known)}"
            self._add("", f"with an unknown {shortened(name)!r}", allowed)

    def _is_told(self) -> bool:
        return any(one.tag == self._told_in for one in self._open)

    def _note(self, unread: str) -> None:
        if self._is_told():
            self._faults.unread[unread] = None

    def _add(self, part: str, value: str, allowed: str) -> None:
        """Add a fault of the innermost open element that is read, or of a part of it."""
        if not self._is_told():
            return
        kind, name, (_, *inside) = self._field or _URDF, "", self._open
        if inside and not self._field:
            owner, *inside = inside
            kind, name = owner.tag, owner.get("name", "")
        words = [one.tag for one in inside]
        self._faults.add(kind, name, " ".join(filter(None, (*words, part))), value, allowed)
        if len(self._faults) >= _MOST_FAULTS:
            self._faults.refuse_if_any()


def _refuse(value: str, allowed: str) -> NoReturn:
    raise InvalidInput(Status.BAD_ROBOT, _URDF, value, allowed)
