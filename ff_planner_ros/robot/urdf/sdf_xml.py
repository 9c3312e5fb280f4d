"""The XML of a model in SDFormat, reduced to inertias, solids and joints.

Elements that only draw, sense or configure a simulator are ignored; any other unknown element or
attribute is refused, since it might change poses or inertias, and so is a second one of what may be
there once.
"""

from __future__ import annotations

from typing import Any, NoReturn
from xml.etree.ElementTree import Element, SubElement
from xml.parsers import expat

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.urdf_faults import listed, shortened
from ff_planner_ros.robot.urdf.urdf_xml import MAX_CHARACTERS, MAX_LINKS, Expanded, parser_for

# Versions of the format: in those before axes and poses mean something else.
_OLDEST, _NEWEST = (1, 5), (1, 99)
_MOST_ELEMENTS = 50 * MAX_LINKS
_POSE: dict[str, Any] = {"pose": {}}
_GEOMETRY: dict[str, Any] = {
    **{name: {size: {} for size in one.sizes} for name, one in PRIMITIVES.items()},
    "mesh": {"uri": {}, "scale": {}},
    "empty": {},
}
_INERTIA: dict[str, Any] = {key: {} for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
_LIMIT: dict[str, Any] = {key: {} for key in ("lower", "upper", "effort", "velocity")}
_DYNAMICS: dict[str, Any] = {key: {} for key in ("damping", "friction", "spring_stiffness")}
_AXIS: dict[str, Any] = {
    "xyz": {},
    "limit": _LIMIT,
    "use_parent_model_frame": {},
    "dynamics": _DYNAMICS | {"spring_reference": {}},
}
_MODEL: dict[str, Any] = {
    "link": {
        "inertial": {"mass": {}, "inertia": _INERTIA, **_POSE},
        "collision": {"geometry": _GEOMETRY, **_POSE},
        **_POSE,
    },
    "joint": {"parent": {}, "child": {}, "axis": _AXIS, **_POSE},
    "frame": _POSE,
    **_POSE,  # in a world, without effect here
}
_SEVERAL = frozenset(("model", "link", "joint", "frame", "collision"))
_ATTRIBUTES = {
    "model": ("name", "canonical_link", "placement_frame"),
    "link": ("name",),
    "joint": ("name", "type"),
    "frame": ("name", "attached_to"),
    "pose": ("relative_to", "rotation_format", "degrees", "frame"),
    "inertial": ("auto",),
    "collision": ("name",),
    "mesh": ("optimization",),
    "xyz": ("expressed_in",),
}
# Ignored: they change no inertia, solid or motion.
_PASSED_OVER = frozenset(
    (
        *("allow_auto_disable", "audio_sink", "audio_source", "battery", "density", "dissipation"),
        *("enable_wind", "gravity", "gripper", "kinematic", "laser_retro", "light"),
        *("max_contacts", "must_be_base_link", "particle_emitter", "physics", "plugin"),
        *("projector", "self_collide", "sensor", "static", "stiffness", "surface"),
        *("velocity_decay", "visual"),
    )
)


def read_model(text: str) -> Element | None:
    """Return the `<model>` of a text in SDFormat; None: the text is something else.

    Raises:
        InvalidInput: The SDF is of another version, not XML, too large, with declarations of its
            own, holds no model or several, or an unknown element.
    """
    # The reader of URDFs refuses other texts that are no XML, or too large.
    if len(text) > MAX_CHARACTERS or "<sdf" not in text:
        return None
    reader = _Reader()
    try:
        parser_for(reader).Parse(text, True)
    except _OtherDocument:
        return None
    except (expat.ExpatError, UnicodeEncodeError) as error:
        if reader.is_other:
            return None
        _refuse("robot.urdf", "not XML", str(error)[:200])
    return reader.model()


class _OtherDocument(Exception):
    """The text is no SDF."""


class _Reader:
    """Builds elements; those that are ignored may be nested to any depth."""

    def __init__(self) -> None:
        self._sdf = Element("sdf")
        self._open: list[tuple[Element, dict[str, Any], list[str]]] = []
        self._passed_over = 0  # elements open, the innermost ones
        self._extension = ""  # the outermost of those, if it has a prefix
        self._count = 0
        self._expanded = Expanded()
        self.is_other = True  # until its outermost tag is known

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self._open:
            if tag != "sdf":
                raise _OtherDocument
            self.is_other = False
            self._expanded.require(tag, attributes)
            _require_version(attributes.get("version", ""))
            self._open.append((self._sdf, {"model": _MODEL}, []))
            return
        owner, parts, _ = self._open[-1]
        self._expanded.require(tag, {} if self._passed_over else attributes)
        # By the format, elements with a prefix are extensions of their author's.
        if self._passed_over or tag in _PASSED_OVER or ":" in tag:
            if not self._passed_over:
                self._extension = tag if ":" in tag else ""
            elif self._extension and tag in ("link", "joint"):
                allowed = "links and joints must be directly in <model>"
                _refuse(f"<{shortened(self._extension)}>", f"unknown, and holds <{tag}>", allowed)
            self._passed_over += 1
            return
        _require_known(owner, parts, tag, attributes)
        self._count += 1
        if self._count > _MOST_ELEMENTS:
            _refuse("robot.urdf", "too large", f"it must have at most {_MOST_ELEMENTS} elements")
        self._open.append((SubElement(owner, tag, attributes), parts[tag], []))

    def end(self, _tag: str) -> None:
        if self._passed_over:
            self._passed_over -= 1
        else:
            element, _, text = self._open.pop()
            element.text = "".join(text)

    def characters(self, data: str) -> None:
        if self._open and not self._passed_over:
            self._open[-1][2].append(data)

    def model(self) -> Element:
        models = self._sdf.findall("model")
        if len(models) != 1:
            _refuse("robot.urdf", f"{len(models)} models", "an SDF must hold one <model>")
        return models[0]


def _require_known(
    owner: Element, parts: dict[str, Any], tag: str, attributes: dict[str, str]
) -> None:
    if tag not in parts:
        allowed = f"of a model, <{owner.tag}> may hold {listed(parts) or 'nothing else'}"
        _refuse(f"<{shortened(tag)}>", f"in <{owner.tag}>", allowed)
    # Shapes are counted at their link.
    if tag not in _SEVERAL and owner.tag != "geometry" and owner.find(tag) is not None:
        _refuse(f"<{tag}>", f"there twice in <{owner.tag}>", "it must be there once")
    known = _ATTRIBUTES.get(tag, ())
    for name in attributes:
        if name not in known and ":" not in name and name != "xmlns":
            allowed = f"it may have {listed(known) or 'no attributes'}"
            _refuse(f"<{tag}>", f"with an unknown {shortened(name)!r}", allowed)


def _require_version(text: str) -> None:
    try:
        major, minor = (int(part) for part in text.split("."))
    except ValueError:
        major, minor = 0, 0
    if not _OLDEST <= (major, minor) <= _NEWEST:
        allowed = f"it must be from {_OLDEST[0]}.{_OLDEST[1]} on, and below 2"
        _refuse("sdf version", repr(shortened(text)), allowed)


def _refuse(field: str, value: str, allowed: str) -> NoReturn:
    raise InvalidInput(Status.BAD_ROBOT, field, value, allowed)
