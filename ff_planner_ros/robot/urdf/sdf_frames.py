"""The frames of a model in SDFormat, whose poses are relative to other frames or to the model."""

from __future__ import annotations

from typing import NoReturn
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.urdf.urdf_faults import LARGEST, finite_numbers, listed, shortened

# The model's own frame, as the format calls it.
MODEL = "__model__"


class Frames:
    """The frames of a model by their names."""

    def __init__(self, model: Element) -> None:
        """Resolve the pose of each frame in the model's.

        Raises:
            InvalidInput: A pose is malformed, a frame has no unique name or does not exist, or
                frames refer to each other in a loop.
        """
        self._told: dict[str, tuple[str, pin.SE3]] = {}  # reference frame, and pose in it
        for tag in ("link", "joint", "frame"):
            for element in model.findall(tag):
                name, above = named(element), MODEL
                if name in self._told or name == MODEL:
                    value = f"the name of two {tag}s or of a {tag} and another frame"
                    _refuse(f"{tag} {shortened(name)!r}", value, "names must be unique")
                if tag == "joint":
                    above = words_of(element.find("child"))
                elif tag == "frame":
                    above = element.get("attached_to") or MODEL
                pose = element.find("pose")
                above = (pose is not None and pose.get("relative_to")) or above
                self._told[name] = above, _pose(pose, f"{tag} {shortened(name)!r}")
        self._places = {MODEL: pin.SE3.Identity()}
        for name in self._told:
            self.place(name)

    def place(self, name: str, told: str = "") -> pin.SE3:
        """Return the pose of a frame in the model's frame.

        Args:
            told: Name of the element that refers to the frame, for errors.

        Raises:
            InvalidInput: There is no such frame.
        """
        way = dict[str, None]()  # in their order
        at = name
        while at not in self._places:
            if at not in self._told:
                allowed = f"it must be one of {listed((*self._told, MODEL))}"
                told = f"frame {shortened(next(reversed(way)))!r}" if way else told
                _refuse(f"{told} relative_to".strip(), repr(shortened(at)), allowed)
            if at in way:
                allowed = "no frame may be told in itself"
                _refuse(f"frame {shortened(at)!r}", "in a ring of frames", allowed)
            way[at] = None
            at = self._told[at][0]
        for one in reversed(way):
            above, pose = self._told[one]
            self._places[one] = self._places[above] * pose
        return self._places[name]

    def pose_in(self, element: Element, link: str) -> pin.SE3:
        """Return the pose of a part of a link, `<collision>` say, in the link's frame."""
        pose, told = element.find("pose"), f"link {shortened(link)!r} {element.tag}"
        found, other = _pose(pose, told), "" if pose is None else pose.get("relative_to", "")
        if not other or other == link:
            return found
        return self.place(link).inverse() * self.place(other, told) * found


def named(element: Element) -> str:
    """Return the name of a link, joint or frame; refuse one without."""
    name = element.get("name", "")
    if not name:
        _refuse(element.tag, "nameless", "it must have a name")
    return name


def words_of(element: Element | None) -> str:
    """Return the text of an element without surrounding blanks; empty: there is none."""
    return "" if element is None else (element.text or "").strip()


def _pose(pose: Element | None, told: str) -> pin.SE3:
    text = words_of(pose)
    if pose is None or not text:
        return pin.SE3.Identity()
    if pose.get("frame"):
        _refuse(f"{told} pose frame", shortened(pose.get("frame", "")), "write relative_to")
    form, numbers = pose.get("rotation_format", "euler_rpy"), finite_numbers(text)
    count = {"euler_rpy": 6, "quat_xyzw": 7}.get(form)
    if count is None:
        allowed = "it must be euler_rpy or quat_xyzw"
        _refuse(f"{told} pose rotation_format", shortened(form), allowed)
    if len(numbers) != count or max(map(abs, numbers)) > LARGEST:
        allowed = f"it must be {count} numbers, none larger than {LARGEST:g}"
        _refuse(f"{told} pose", repr(shortened(text)), allowed)
    turn = np.array(numbers[3:])
    if form == "quat_xyzw":
        if abs(float(np.linalg.norm(turn)) - 1.0) > 1e-3:
            _refuse(f"{told} pose", repr(shortened(text)), "its quaternion must have length 1")
        rotation = pin.Quaternion(turn / np.linalg.norm(turn)).toRotationMatrix()
        return pin.SE3(rotation, np.array(numbers[:3]))
    if pose.get("degrees", "false").strip().lower() in ("true", "1"):
        turn = np.deg2rad(turn)
    return pin.SE3(pin.rpy.rpyToMatrix(turn), np.array(numbers[:3]))


def _refuse(field: str, value: str, allowed: str) -> NoReturn:
    raise InvalidInput(Status.BAD_ROBOT, field, value, allowed)
