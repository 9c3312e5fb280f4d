"""A model in SDFormat: what is read of it, what the rest means for a plan, and its frames.

Poses are relative to other frames or to the model.
"""

from __future__ import annotations

from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.urdf.urdf_faults import LARGEST, Faults, finite_numbers, listed, shortened
from ff_planner_ros.robot.urdf.xml_reader import Format, Tag

# The model's own frame, as the format calls it.
MODEL = "__model__"

_SIMULATOR = "settings of a simulator, which change no plan"
_SENSES = "what senses, shines or only looks changes no plan"
# Wherever they are.
_UNREAD = {
    **dict.fromkeys(
        (
            *("allow_auto_disable", "enable_wind", "gravity", "kinematic", "max_contacts"),
            *("must_be_base_link", "physics", "plugin", "self_collide", "static", "surface"),
            *("contact", "density", "gripper"),
        ),
        _SIMULATOR,
    ),
    **dict.fromkeys(
        (
            *("audio_sink", "audio_source", "battery", "laser_retro", "light"),
            *("material", "particle_emitter", "projector", "sensor", "visual"),
        ),
        _SENSES,
    ),
    "dissipation": "a limit stops a joint at once",
    "stiffness": "a limit stops a joint at once",
    "velocity_decay": "nothing slows a body down in orbit",
}
_OF_OTHER_JOINTS = dict.fromkeys(
    ("axis2", "gearbox_ratio", "gearbox_reference_body", "screw_thread_pitch", "thread_pitch"),
    "they count for joints of types that are refused",
)
_AROUND = dict.fromkeys(
    (
        *("atmosphere", "audio", "gui", "magnetic_field", "road", "scene", "spherical_coordinates"),
        *("state", "wind", "@name"),
    ),
    "a model is the same in any world",
)


def _row(*attributes: str, **parts: Tag) -> Tag:
    return Tag(attributes, parts, _UNREAD)


def _several(row: Tag) -> Tag:
    return replace(row, several=True)


_TEXT = Tag(has_text=True)
_POSE = Tag(("relative_to", "rotation_format", "degrees", "frame"), unread=_UNREAD, has_text=True)
_GEOMETRY = _row(
    **{name: _row(**dict.fromkeys(one.sizes, _TEXT)) for name, one in PRIMITIVES.items()},
    mesh=replace(
        _row(uri=_TEXT, scale=_TEXT),
        unread=_UNREAD | {"@optimization": "a mesh counts as its convex hull"},
    ),
    empty=_row(),
)
_INERTIA = _row(**dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), _TEXT))
_AXIS = _row(
    xyz=Tag(("expressed_in",), unread=_UNREAD, has_text=True),
    limit=_row(**dict.fromkeys(("lower", "upper", "effort", "velocity"), _TEXT)),
    use_parent_model_frame=_TEXT,
    dynamics=replace(
        _row(**dict.fromkeys(("damping", "friction", "spring_stiffness"), _TEXT)),
        unread=_UNREAD | {"spring_reference": "a spring is named in a note, and not counted"},
    ),
)
_NAMED_PARTS = {
    "link": _several(
        _row(
            "name",
            inertial=_row("auto", mass=_TEXT, inertia=_INERTIA, pose=_POSE),
            collision=_several(_row("name", geometry=_GEOMETRY, pose=_POSE)),
            pose=_POSE,
        )
    ),
    "joint": _several(
        replace(
            _row("name", "type", parent=_TEXT, child=_TEXT, axis=_AXIS, pose=_POSE),
            unread=_UNREAD | _OF_OTHER_JOINTS,
        )
    ),
    "frame": _several(_row("name", "attached_to", pose=_POSE)),
}
_WHERE = "where a model is in its world is told by the state"
_MODEL = Tag(
    ("name",),
    _NAMED_PARTS,
    _UNREAD | {"pose": _WHERE, "@canonical_link": _WHERE, "@placement_frame": _WHERE},
    several=True,
)
SDF = Format(
    "sdf",
    Tag(
        ("version",),
        {"model": _MODEL, "world": Tag((), {"model": _MODEL}, _UNREAD | _AROUND)},
        _UNREAD,
    ),
    most=50_000,
    told_most="50000 elements",
    counted=float("inf"),
    never_within=frozenset(("link", "joint")),
)


class Frames:
    """The frames of a model by their names."""

    def __init__(self, model: Element, faults: Faults) -> None:
        """Resolve the pose of each frame in the model's.

        Args:
            faults: Collects malformed poses, names that are missing or not unique, frames that do
                not exist, and rings of frames.
        """
        self._faults = faults
        # Reference frame, pose in it, and element of each
        self._told: dict[str, tuple[str, pin.SE3, Element]] = {}
        for tag in ("link", "joint", "frame"):
            for element in model.findall(tag):
                name, above, pose = element.get("name", ""), MODEL, element.find("pose")
                if not name:
                    faults.add(tag, "", "", "nameless", "it must have a name", element)
                    continue
                if name in self._told or name == MODEL:
                    value = f"the name of two {tag}s or of a {tag} and another frame"
                    faults.add(tag, name, "", value, "names must be unique", element)
                    continue
                if tag == "joint":
                    above = words_of(element.find("child"))
                elif tag == "frame":
                    above = element.get("attached_to") or MODEL
                above = (pose is not None and pose.get("relative_to")) or above
                self._told[name] = above, self._pose(pose, element, ""), element
        self._places = {MODEL: pin.SE3.Identity()}
        for name in self._told:
            self.place(name)

    def place(self, name: str, owner: Element | None = None, part: str = "") -> pin.SE3:
        """Return the pose of a frame in the model's frame; identity: there is none.

        Args:
            owner: Link or joint that refers to the frame, for faults.
            part: Of that one.
        """
        way = dict[str, None]()  # in their order
        at = name
        while at not in self._places:
            if at not in self._told or at in way:
                self._add_lost(at, way, owner, part)
                break
            way[at] = None
            at = self._told[at][0]
        for one in reversed(way):
            above, pose, _ = self._told[one]
            self._places[one] = self._places.get(above, pin.SE3.Identity()) * pose
        return self._places.get(name, pin.SE3.Identity())

    def _add_lost(self, at: str, way: dict[str, None], owner: Element | None, part: str) -> None:
        """Add the fault of a frame that does not exist, or refers to itself."""
        if at in way:
            allowed, element = "no frame may be told in itself", self._told[at][2]
            self._faults.add("frame", at, "", "in a ring of frames", allowed, element)
            return
        kind, name = ("", "") if owner is None else (owner.tag, owner.get("name", ""))
        if way:
            kind, name, part = "frame", next(reversed(way)), ""
            owner = self._told[name][2]
        allowed = f"it must be one of {listed((*self._told, MODEL))}"
        told = f"{part} relative_to".strip()
        self._faults.add(kind, name, told, repr(shortened(at)), allowed, owner)

    def pose_in(self, part: Element, link: Element) -> pin.SE3:
        """Return the pose of a part of a link, `<collision>` say, in the link's frame."""
        pose, name = part.find("pose"), link.get("name", "")
        found, other = self._pose(pose, link, part.tag), ""
        if pose is not None:
            other = pose.get("relative_to", "")
        if not other or other == name:
            return found
        return self.place(name).inverse() * self.place(other, link, part.tag) * found

    def _pose(self, pose: Element | None, owner: Element, part: str) -> pin.SE3:
        """Return a `<pose>` of an element, or of a part of it; identity: it is faulty."""
        text = words_of(pose)
        if pose is None or not text:
            return pin.SE3.Identity()

        def add(key: str, value: str, allowed: str) -> None:
            told = " ".join(filter(None, (part, "pose", key)))
            self._faults.add(owner.tag, owner.get("name", ""), told, value, allowed, pose)

        form, numbers = pose.get("rotation_format", "euler_rpy"), finite_numbers(text)
        count = {"euler_rpy": 6, "quat_xyzw": 7}.get(form, 0)
        turn = np.array(numbers[3:])
        if pose.get("frame"):
            add("frame", shortened(pose.get("frame", "")), "write relative_to")
        elif not count:
            add("rotation_format", shortened(form), "it must be euler_rpy or quat_xyzw")
        elif len(numbers) != count or max(map(abs, numbers)) > LARGEST:
            allowed = f"it must be {count} numbers, none larger than {LARGEST:g}"
            add("", repr(shortened(text)), allowed)
        elif form == "quat_xyzw" and abs(float(np.linalg.norm(turn)) - 1.0) > 1e-3:
            add("", repr(shortened(text)), "its quaternion must have length 1")
        elif form == "quat_xyzw":
            rotation = pin.Quaternion(turn / np.linalg.norm(turn)).toRotationMatrix()
            return pin.SE3(rotation, np.array(numbers[:3]))
        else:
            if pose.get("degrees", "false").strip().lower() in ("true", "1"):
                turn = np.deg2rad(turn)
            return pin.SE3(pin.rpy.rpyToMatrix(turn), np.array(numbers[:3]))
        return pin.SE3.Identity()


def words_of(element: Element | None) -> str:
    """Return the text of an element without surrounding blanks; empty: there is none."""
    return "" if element is None else (element.text or "").strip()
