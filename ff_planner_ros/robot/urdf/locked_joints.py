"""Joints that are locked: where each of them is, and where that puts the link that it carries."""

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

NOTHING_HELD: Mapping[str, float] = MappingProxyType({})

_FIXED = "fixed"
_UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}

# Shortest axis, which should be a unit vector; a shorter one is rounding.
_SHORTEST_AXIS = 1e-6

# Between a given position and that of a joint that is mimicked [rad, m]: people write few digits.
_SAME_POSITION = 1e-3


def locked_positions(
    joints: Mapping[str, Element],
    planned: Collection[str],
    given: Mapping[str, float],
    field: str,
    faults: Faults,
) -> dict[str, float]:
    """Return the position of each joint that is not planned [rad, m], zero for a fixed one.

    It is as given, or follows from the locked joint that it mimics, or else is zero, or the limit
    nearest to zero. A joint that moves because it mimics a planned one is a fault.

    Args:
        joints: All joints of the URDF, by name.
        planned: Names of the joints that are not locked.
        given: Positions by name.
        field: Name of `given` in faults.
    """
    given = {n: at for n, at in given.items() if _can_be_locked(joints, n, at, field, faults)}
    mimics = {one: _mimic(joint, joints) for one, joint in joints.items() if one not in planned}
    found = dict[str, float]()
    for name in mimics:
        way = {name: None}  # each mimics the next one
        last = name
        while (mimic := mimics.get(last)) is not None:
            last = mimic.get("joint", "")
            if last in way or not last or last in planned:
                _add_fault(name, last, last in planned, field, faults)
                break
            way[last] = None
        else:
            for one in reversed(way):
                if one not in found:
                    found[one] = _position(
                        one, joints[one], mimics[one], found, given, field, faults
                    )
    return found


def without_mimicked(joints: Mapping[str, Element]) -> list[str]:
    """Return notes on joints that are locked by themselves: nothing is there that they mimic."""
    named = {
        name: mimic.get("joint", "")
        for name, joint in joints.items()
        if (mimic := joint.find("mimic")) is not None and joint.get("type") != "fixed"
    }
    told = [f"{name} mimics {of}" for name, of in named.items() if of and of not in joints]
    return [f"joints that mimic one that is not there: {listed(told, LONGEST_NOTE)}"] * bool(told)


def _mimic(joint: Element, joints: Mapping[str, Element]) -> Element | None:
    mimic = None if joint.get("type") == "fixed" else joint.find("mimic")
    if mimic is not None and (of := mimic.get("joint")) and of not in joints:
        return None
    return mimic


def _add_fault(name: str, mimicked: str, is_planned: bool, field: str, faults: Faults) -> None:
    """Add the fault of a joint that mimics one that no locked joint can mimic."""
    if is_planned:
        value = f"a mimic of {mimicked}, which is planned"
        allowed = f"lock {mimicked} in {field}, or make {name} a fixed joint"
    elif mimicked:
        value, allowed = "in a ring of joints that mimic each other", "one must move by itself"
    else:
        value, allowed = "a mimic of no joint", "its <mimic> must name one"
    faults.add("joint", name, "", value, allowed)


def _position(
    name: str,
    joint: Element,
    mimic: Element | None,
    found: Mapping[str, float],
    given: Mapping[str, float],
    field: str,
    faults: Faults,
) -> float:
    """Return the position of a locked joint; `found` has that of the joint that it mimics."""
    if mimic is None:
        return given.get(name, _nearest_to_zero(joint))
    along = {"multiplier": 1.0, "offset": 0.0}
    for key in along:
        if mimic.get(key) is not None:
            along[key] = faults.number("joint", name, f"mimic {key}", mimic, key)
    mimicked = mimic.get("joint", "")
    at = along["multiplier"] * found[mimicked] + along["offset"]
    if math.isnan(at):  # a fault already
        return 0.0
    if abs(at) > LARGEST:
        faults.add("joint", name, "mimic", f"at {at:g}", f"its size must be at most {LARGEST:g}")
        return 0.0
    if abs(given.get(name, at) - at) > _SAME_POSITION:
        allowed = f"it mimics {mimicked}, which puts it at {at:g}: lock {mimicked} instead"
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
            found.append(LockedJoint(name, kind, at))
    return tuple(found)


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
