"""Joints that are not planned: locked ones, and where they are, and those that others drive."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ff_planner_ros.robot.urdf.urdf_faults import LARGEST, LONGEST_NOTE, Faults, listed
from ff_planner_ros.robot.urdf.urdf_xml import LOCKED

# The word for the positions of locked joints that are those last measured.
MEASURED = "measured"

NOTHING_HELD: Mapping[str, float] = MappingProxyType({})

_FIXED = "fixed"
_UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}

# Shortest axis, which should be a unit vector; a shorter one is rounding.
_SHORTEST_AXIS = 1e-6

# Between a given position and that of a joint that is mimicked [rad, m]: people write few digits.
_SAME_POSITION = 1e-3


class Drive(NamedTuple):
    """What a joint mimics: it is at multiplier times the position of that, plus an offset."""

    of: str  # name of the other joint
    multiplier: float
    offset: float  # [rad, m]


def locked_and_driven(
    joints: Mapping[str, Element],
    planned: Collection[str],
    given: Mapping[str, float],
    field: str,
    faults: Faults,
) -> tuple[dict[str, float], dict[str, Drive]]:
    """Return the position of each joint that is locked [rad, m], and what drives others, by name.

    A joint that is not planned is driven if it mimics a planned one, by itself or by others. Else
    it is locked: as given, as follows from the locked joint that it mimics, at zero, or at the
    limit nearest to zero; one that is fixed is at zero.

    Args:
        joints: All joints of the URDF, by name.
        planned: Names of the joints that move by themselves.
        given: Positions by name.
        field: Name of `given` in faults.
    """
    given = {n: at for n, at in given.items() if _can_be_locked(joints, n, at, field, faults)}
    mimics = {
        one: _mimic(one, joint, joints, faults)
        for one, joint in joints.items()
        if one not in planned
    }
    found, driven = dict[str, float](), dict[str, Drive]()
    for name in mimics:
        way = {name: None}  # each mimics the next one
        last = name
        while last not in planned and (mimic := mimics.get(last)) is not None:
            last = mimic.of
            if last in way or not last:
                _add_fault(name, last, faults)
                break
            way[last] = None
        else:
            for one in reversed(way):
                drive = mimics.get(one)
                if one in found or one in driven or one in planned:
                    continue
                if drive is None or drive.of in found:
                    found[one] = _position(one, joints[one], drive, found, given, field, faults)
                    continue
                if one in given:
                    allowed = f"it mimics {last}, which is planned: lock {last} instead"
                    faults.add(field, one, "", given[one], allowed)
                through = _through(drive, driven.get(drive.of))
                if through.multiplier:
                    driven[one] = through
                else:
                    found[one] = through.offset
    return found, driven


def _through(drive: Drive, mimicked: Drive | None) -> Drive:
    """Return what a planned joint does by way of one that mimics it; None: by itself."""
    if mimicked is None:
        return drive
    of, multiplier, offset = mimicked
    return Drive(of, drive.multiplier * multiplier, drive.multiplier * offset + drive.offset)


def mimics(xml: str) -> dict[str, Drive]:
    """Return what each joint of a checked URDF mimics that mimics one."""
    return {
        joint.get("name", ""): Drive(
            mimic.get("joint", ""),
            float(mimic.get("multiplier", "1")),
            float(mimic.get("offset", "0")),
        )
        for joint in ElementTree.fromstring(xml).findall("joint[mimic]")
        for mimic in joint.iter("mimic")
    }


def without_mimicked(joints: Mapping[str, Element]) -> list[str]:
    """Return notes on joints that are locked by themselves: nothing is there that they mimic."""
    named = {
        name: mimic.get("joint", "")
        for name, joint in joints.items()
        if (mimic := joint.find("mimic")) is not None and joint.get("type") != "fixed"
    }
    told = [f"{name} mimics {of}" for name, of in named.items() if of and of not in joints]
    return [f"joints that mimic one that is not there: {listed(told, LONGEST_NOTE)}"] * bool(told)


def _mimic(
    name: str, joint: Element, joints: Mapping[str, Element], faults: Faults
) -> Drive | None:
    mimic = None if joint.get("type") == _FIXED else joint.find("mimic")
    if mimic is None or ((of := mimic.get("joint")) and of not in joints):
        return None
    along = {"multiplier": 1.0, "offset": 0.0}
    for key in along:
        if mimic.get(key) is not None:
            along[key] = faults.number("joint", name, f"mimic {key}", mimic, key)
    return Drive(mimic.get("joint", ""), **along)


def _add_fault(name: str, mimicked: str, faults: Faults) -> None:
    """Add the fault of a joint that mimics one that it cannot mimic."""
    if mimicked:
        value, allowed = "in a ring of joints that mimic each other", "one must move by itself"
    else:
        value, allowed = "a mimic of no joint", "its <mimic> must name one"
    faults.add("joint", name, "", value, allowed)


def _position(
    name: str,
    joint: Element,
    drive: Drive | None,
    found: Mapping[str, float],
    given: Mapping[str, float],
    field: str,
    faults: Faults,
) -> float:
    """Return the position of a locked joint; `found` has that of the joint that it mimics."""
    if drive is None:
        return given.get(name, _nearest_to_zero(joint))
    at = drive.multiplier * found[drive.of] + drive.offset
    if math.isnan(at):  # a fault already
        return 0.0
    if abs(at) > LARGEST:
        faults.add("joint", name, "mimic", f"at {at:g}", f"its size must be at most {LARGEST:g}")
        return 0.0
    if abs(given.get(name, at) - at) > _SAME_POSITION:
        allowed = f"it mimics {drive.of}, which puts it at {at:g}: lock {drive.of} instead"
        faults.add(field, name, "", given[name], allowed)
    return given.get(name, at)


def _nearest_to_zero(joint: Element) -> float:
    """Return zero, or the limit of a joint that is nearest to zero."""
    limit, aside = joint.find("limit"), Faults()  # faulty limits of a locked joint do not matter
    lower, upper = (aside.number("", "", "", limit, key) for key in ("lower", "upper"))
    limited = joint.get("type") in ("revolute", "prismatic") and lower <= upper
    return min(max(0.0, lower), upper) if limited else 0.0


def _can_be_locked(
    joints: Mapping[str, Element], name: str, at: float, field: str, faults: Faults
) -> bool:
    """Tell whether a joint can be locked at a position; add a fault if it cannot."""
    movable = sorted(name for name, joint in joints.items() if joint.get("type") != "fixed")
    kind = joints[name].get("type") if name in joints else "fixed"
    if kind == "fixed":
        allowed = f"it must be one of the joints that move: {listed(movable)}"
        faults.add(field, name, "", "unknown", allowed)
    elif kind not in _UNITS:
        allowed = f"only joints that are {', '.join(_UNITS)} can be held somewhere"
        faults.add(field, name, "", f"of a joint that is {kind}", allowed)
    elif not abs(at) <= LARGEST:
        faults.add(field, name, "", at, f"its size must be at most {LARGEST:g}")
    else:
        return True
    return False


def lock(joint: Element, at: float, place: pin.SE3 | None, faults: Faults) -> pin.SE3 | None:
    """Return where a locked joint puts the link that it carries; None: something is faulty.

    Args:
        at: Position of the joint [rad, m].
        place: Placement of the link with the joint at zero; None: it is faulty.
    """
    name, kind = joint.get("name", ""), joint.get("type", "")
    if kind not in _UNITS:
        allowed = f"it must be {', '.join(_UNITS)} or fixed"
        if kind:  # one of no type is a fault already
            faults.add("joint", name, "", kind, allowed)
        return None
    if at == 0.0 or place is None:
        return place
    if not has_axis(joint, faults):
        return None
    axis = joint.find("axis")
    direction = np.zeros(3) if axis is None else np.array(axis.get("xyz", "").split(), float)
    way = at / np.linalg.norm(direction) * direction
    turned = kind != "prismatic"
    motion = pin.SE3(pin.exp3(way), np.zeros(3)) if turned else pin.SE3(np.eye(3), way)
    return place * motion


def make_fixed(joint: Element, place: pin.SE3 | None) -> None:
    """Make a joint a fixed one, whose link is elsewhere than its origin says if that is given."""
    joint.set("type", "fixed")
    drop(joint, "axis", "limit", "mimic")
    if place is not None:
        drop(joint, "origin")
        numbers = place.translation, pin.rpy.matrixToRpy(place.rotation)
        xyz, rpy = (" ".join(map(repr, vector.tolist())) for vector in numbers)
        SubElement(joint, "origin", xyz=xyz, rpy=rpy)


def drop(joint: Element, *tags: str) -> None:
    """Remove the parts of a joint of some tags."""
    for part in [part for part in joint if part.tag in tags]:
        joint.remove(part)


def told_position(joint: Element, at: float) -> str:
    """Return name and position of a locked joint as text."""
    return f"{joint.get('name', '')} at {at:g} {_UNITS.get(joint.get('type', ''), '')}".rstrip()


def has_axis(joint: Element, faults: Faults) -> bool:
    """Tell whether the axis of a joint is sound, and write it if it is the format's default."""
    name, axis, told = joint.get("name", ""), joint.find("axis"), len(faults)
    if axis is None:
        SubElement(joint, "axis", xyz="1.0 0.0 0.0")
    elif axis.get("xyz") is None:
        faults.add("joint", name, "axis xyz", "missing", "it must be three finite numbers")
    elif faults.vectors("joint", name, "axis", axis) and _length(axis) < _SHORTEST_AXIS:
        faults.add("joint", name, "axis", axis.get("xyz"), "it must have a direction")
    return len(faults) == told


def _length(axis: Element) -> float:
    return math.hypot(*map(float, axis.get("xyz", "").split()))


class LockedJoint(NamedTuple):
    """A joint that the planner takes for fixed, and where."""

    name: str
    type: str  # `revolute`, `continuous` or `prismatic`; `fixed` where the URDF itself fixes it
    position: float  # [rad, m]; zero of a fixed one
    follows: bool = False  # whether a locked joint that it mimics takes it there

    @property
    def unit(self) -> str:
        """Unit of the position; of a fixed one, of what a message says of it."""
        return _UNITS.get(self.type, "rad")

    @property
    def is_fixed(self) -> bool:
        """Whether the URDF itself fixes it, so that it can be locked nowhere else."""
        return self.type == _FIXED


def locked_joints_in(
    joints: Mapping[str, Element], where: Mapping[str, float]
) -> tuple[LockedJoint, ...]:
    """Return the joints that are to be locked, as a URDF has them.

    Args:
        joints: All joints, by name; those that can do more than turn or slide are left out.
        where: Positions of those that are locked [rad, m].
    """
    found = []
    for name, at in where.items():
        joint = joints[name]
        kind = joint.get("type", "")
        if kind == _FIXED:
            told = joint.find(LOCKED)  # of a recorded URDF
            kind = _FIXED if told is None else told.get("type", "")
            at = 0.0 if told is None else Faults().number("", "", "", told, "position")
        if kind in (*_UNITS, _FIXED):
            mimic = joint.find("mimic")
            follows = kind != _FIXED and mimic is not None and mimic.get("joint") in joints
            found.append(LockedJoint(name, kind, at, follows))
    return tuple(found)


def measurable(locked_joints: Sequence[LockedJoint], given: Collection[str]) -> list[str]:
    """Return the joints that are locked where they were measured, but for those that are given."""
    return [
        one.name
        for one in locked_joints
        if not one.is_fixed and not one.follows and one.name not in given
    ]


def with_locked(xml: str, locked_joints: Sequence[LockedJoint]) -> str:
    """Return a checked URDF that says where joints are locked that are fixed ones in it."""
    places = {one.name: one for one in locked_joints if not one.is_fixed}
    if not places:
        return xml
    robot = ElementTree.fromstring(xml)
    for joint in robot.findall("joint"):
        if (one := places.get(joint.get("name", ""))) is not None:
            SubElement(joint, LOCKED, type=one.type, position=repr(one.position))
    return ElementTree.tostring(robot, encoding="unicode")
