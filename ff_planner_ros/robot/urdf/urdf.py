"""The check of a URDF before Pinocchio reads it, so that errors name each fault and its place."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.urdf.urdf_bodies import SMALLEST, check_bodies, placement
from ff_planner_ros.robot.urdf.urdf_faults import (
    LARGEST,
    LONGEST_NOTE,
    Faults,
    listed,
    shortened,
)
from ff_planner_ros.robot.urdf.urdf_tree import Tree, link_of, one_of, tree_of
from ff_planner_ros.robot.urdf.urdf_xml import read_elements

# The planner's bound of continuous joints, either way from the turn of the start [rad].
TURN_OF_CONTINUOUS = 4.0 * math.pi

# Shortest axis, which should be a unit vector; a shorter one is rounding.
SHORTEST_AXIS = 1e-6

_UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}

NOTHING_HELD: Mapping[str, float] = MappingProxyType({})


class CheckedUrdf(NamedTuple):
    """A URDF that passed the check, with its base and tip link."""

    xml: str  # links and joints, without shapes, transmissions and simulator tags
    base_link: str
    tip_link: str
    notes: tuple[str, ...]  # for the user: joints that are locked, say


def checked_urdf(
    text: str,
    base_link: str | None = None,
    tip_link: str | None = None,
    held_at: Mapping[str, float] = NOTHING_HELD,
    holds_slides: bool = False,
) -> CheckedUrdf:
    """Check a URDF, and return it reduced to links and joints, with all but the arm's joints fixed.

    The arm's joints are the revolute and prismatic ones between base and tip. All others, those of
    a gripper or of another arm, become fixed joints, at zero or at the limit nearest to zero.

    Args:
        base_link: None: the root.
        tip_link: None: the only link that moves and carries no other.
        held_at: Positions of joints that are locked [rad, m]; they may be in the arm.
        holds_slides: Prismatic joints of the arm are locked, too.

    Raises:
        InvalidInput: No chain of movable joints leads from base link to tip link, an inertia is
            impossible, or the URDF is otherwise faulty. The error tells all faults.
    """
    faults = Faults()
    robot = read_elements(text)
    tree = tree_of(robot, faults)
    chain: Sequence[Element] | None = None
    if tree.links:
        broken = len(faults) > 0
        if base_link is None:
            base_link = next(iter(tree.roots), None)  # none: a loop, which is a fault already
        if tip_link is None:
            tip_link = _only_leaf(tree, faults)
        chain = _chain(tree, base_link, tip_link, broken, faults)
    placements = {
        link: placement(joint.find("origin"))
        if faults.vectors("joint", _name(joint), "origin", joint.find("origin"))
        else None
        for link, joint in tree.above.items()
    }
    notes: list[str] = []
    if chain is not None:
        if holds_slides:
            sliding = [_name(joint) for joint in chain if joint.get("type") == "prismatic"]
            held_at = _held_where_they_are(tree, sliding) | dict(held_at)
        notes += _check_joints(tree, chain, base_link or "", placements, held_at, faults)
    notes += check_bodies(tree, placements, base_link or "", faults)
    faults.refuse_if_any()
    ElementTree.indent(robot)
    xml = ElementTree.tostring(robot, encoding="unicode")
    return CheckedUrdf(xml, base_link or "", tip_link or "", tuple(notes))


def _name(joint: Element) -> str:
    return joint.get("name", "")


def _only_leaf(tree: Tree, faults: Faults) -> str | None:
    leaves = tree.leaves
    # A link that is fixed to the chaser, a panel say, is no end effector.
    moved = [
        leaf for leaf in leaves if any(j.get("type") != "fixed" for j in tree.upwards(leaf))
    ] or leaves
    if len(moved) == 1:
        return moved[0]
    allowed = f"it must be one of {listed(leaves)}" if leaves else "no link carries no other"
    faults.add("robot.tip_link", "", "", "not given", allowed)
    return None


def _chain(
    tree: Tree, base_link: str | None, tip_link: str | None, broken: bool, faults: Faults
) -> list[Element] | None:
    """Return the joints from base to tip; None: a fault hides them."""
    known = True
    for field, link in (("robot.base_link", base_link), ("robot.tip_link", tip_link)):
        if link is not None and link not in tree.links:
            faults.add(field, "", "", link or "empty", one_of(tree.links))
            known = False
    if base_link is None or tip_link is None or not known:
        return None
    chain = tree.chain(base_link, tip_link)
    if chain is None and not broken:
        allowed = f"it must hang on the base link {shortened(base_link)!r}"
        faults.add("robot.tip_link", "", "", tip_link, allowed)
    return chain


def _check_joints(
    tree: Tree,
    chain: Sequence[Element],
    base_link: str,
    placements: dict[str, pin.SE3 | None],
    held_at: Mapping[str, float],
    faults: Faults,
) -> list[str]:
    """Check the joints of the arm, fix all others, and return notes on these."""
    movable = {_name(joint) for joint in tree.above.values() if joint.get("type") != "fixed"}
    for name in [name for name in held_at if name not in movable]:
        allowed = f"it must be one of the joints that move: {listed(sorted(movable))}"
        faults.add("robot.locked_joints", name, "", "unknown", allowed)
    held_at = {name: at for name, at in held_at.items() if _can_be_held(tree, name, at, faults)}
    moving = [
        joint for joint in chain if joint.get("type") != "fixed" and _name(joint) not in held_at
    ]
    for arm_joint in moving:
        _check_arm_joint(_name(arm_joint), arm_joint, faults)
    if not moving:
        allowed = "at least one must turn or slide between base and tip"
        faults.add("number of joints from base to tip", "", "", 0, allowed)
    # Links that move with the tip, and all that they carry.
    under_base = {link_of(joint, "child") for joint in tree.upwards(base_link)}
    first = link_of(moving[-1], "child") if moving else tree.order[0]
    beyond: set[str] = {first}
    held, held_elsewhere = list[str](), list[str]()
    still = {_name(joint): joint for joint in tree.above.values() if joint not in moving}
    where = {name: _where_held(name, still, held_at) for name in still}
    for link in tree.order:
        joint = tree.above.get(link)
        if joint is None or joint in moving:
            continue
        if link_of(joint, "parent") in beyond:
            beyond.add(link)
        if joint.get("type") == "fixed":
            _drop(joint, "axis", "limit", "mimic")
        elif link in under_base:
            value = "movable and carries the base link"
            faults.add("joint", _name(joint), "", value, "make it fixed")
        else:
            told = held if link in beyond else held_elsewhere
            told.append(_hold(joint, placements, link, where[_name(joint)]))
    notes = [f"held, because the end effector carries them: {listed(held, LONGEST_NOTE)}"] if held else []
    if held_elsewhere:
        why = "they do not belong to the arm, or are to be held"
        notes.append(f"held, because {why}: {listed(held_elsewhere, LONGEST_NOTE)}")
    return notes


def _held_where_they_are(tree: Tree, names: Sequence[str]) -> dict[str, float]:
    """Return the default positions of locked joints: zero, or the limit nearest to it."""
    still = {name: tree.joints[name] for name in names}
    return {name: _where_held(name, still, NOTHING_HELD) for name in names}


def _can_be_held(tree: Tree, name: str, at: float, faults: Faults) -> bool:
    """Tell whether a joint can be locked at a position; add a fault if it cannot."""
    kind = tree.joints[name].get("type") if name in tree.joints else None
    if kind not in (*_UNITS, "fixed", None):
        allowed = f"only joints that are {', '.join(_UNITS)} can be held somewhere"
        faults.add("robot.locked_joints", name, "", f"of a joint that is {kind}", allowed)
    elif not abs(at) <= LARGEST:
        faults.add("robot.locked_joints", name, "", at, f"its size must be at most {LARGEST:g}")
    else:
        return True
    return False


def _check_arm_joint(name: str, joint: Element, faults: Faults) -> None:
    kind = joint.get("type")
    if joint.find("mimic") is not None:
        faults.add("joint", name, "", "a mimic", "every joint of the arm must move by itself")
    if kind == "continuous":
        _limit_continuous(joint)
        _check_limits(name, joint, faults)
    elif kind not in ("revolute", "prismatic"):
        allowed = "it must be revolute, prismatic or fixed"
        faults.add("joint", name, "", kind or "of no type", allowed)
    else:
        _check_limits(name, joint, faults)
    axis = joint.find("axis")
    if axis is None:
        SubElement(joint, "axis", xyz="1.0 0.0 0.0")  # the format's default
    elif axis.get("xyz") is None:
        faults.add("joint", name, "axis xyz", "missing", "it must be three finite numbers")
    elif faults.vectors("joint", name, "axis", axis) and _length(axis) < SHORTEST_AXIS:
        faults.add("joint", name, "axis", axis.get("xyz"), "it must have a direction")


def _length(axis: Element) -> float:
    return math.hypot(*map(float, axis.get("xyz", "").split()))


def _check_limits(name: str, joint: Element, faults: Faults) -> None:
    limit = joint.find("limit")
    if limit is None:
        allowed = "it needs lower, upper, velocity and effort"
        faults.add("joint", name, "limit", "missing", allowed)
        return
    lower, upper, velocity, effort = (
        faults.number("joint", name, f"limit {key}", limit, key)
        for key in ("lower", "upper", "velocity", "effort")
    )
    if lower >= upper:
        faults.add("joint", name, "limit lower", lower, f"it must be below upper, {upper:g}")
    if velocity < SMALLEST:
        allowed = f"it must be at least {SMALLEST:g}"
        faults.add("joint", name, "limit velocity", velocity, allowed)
    if effort < 0.0:
        allowed = "it must not be negative; 0 means unknown"
        faults.add("joint", name, "limit effort", effort, allowed)


def _limit_continuous(joint: Element) -> None:
    """Give a continuous joint the planner's bound, which the format has none of."""
    limit = joint.find("limit")
    if limit is not None:
        limit.set("lower", repr(-TURN_OF_CONTINUOUS))
        limit.set("upper", repr(TURN_OF_CONTINUOUS))


def _where_held(name: str, still: dict[str, Element], held_at: Mapping[str, float]) -> float:
    """Return the position of a locked joint: as given, or as the locked joint that it mimics.

    Else zero, or the limit nearest to it.
    """
    factor, offset = 1.0, 0.0
    aside = Faults()  # faulty limits of a locked joint do not matter
    for _ in still:  # a longer chain of mimic joints is a loop
        mimic = still[name].find("mimic")
        if name in held_at or mimic is None or mimic.get("joint") not in still:
            break
        along = {"multiplier": 1.0, "offset": 0.0}
        for key in along:
            if mimic.get(key) is not None:
                along[key] = aside.number("", "", "", mimic, key)
        offset += factor * along["offset"]
        factor *= along["multiplier"]
        name = mimic.get("joint", "")
    limit = still[name].find("limit")
    lower, upper = (aside.number("", "", "", limit, key) for key in ("lower", "upper"))
    limited = still[name].get("type") in ("revolute", "prismatic") and lower <= upper
    at = held_at.get(name, min(max(0.0, lower), upper) if limited else 0.0)
    at = factor * at + offset
    return at if abs(at) <= LARGEST else 0.0


def _hold(joint: Element, placements: dict[str, pin.SE3 | None], link: str, at: float) -> str:
    """Make a joint a fixed one, and return its name and position as text."""
    kind, aside = joint.get("type", ""), Faults()
    axis = joint.find("axis")
    direction = np.array([1.0, 0.0, 0.0])
    if axis is not None and aside.vectors("", "", "", axis):
        direction = np.array(axis.get("xyz", "").split(), float)
    place, length = placements[link], np.linalg.norm(direction)
    if at != 0.0 and length >= SHORTEST_AXIS and place is not None:
        way = at / length * direction
        turned = kind != "prismatic"
        motion = pin.SE3(pin.exp3(way), np.zeros(3)) if turned else pin.SE3(np.eye(3), way)
        place = placements[link] = place * motion
        _drop(joint, "origin")
        xyz, rpy = place.translation, pin.rpy.matrixToRpy(place.rotation)
        SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
    joint.set("type", "fixed")
    _drop(joint, "axis", "limit", "mimic")
    return f"{_name(joint)} at {at:g} {_UNITS.get(kind, '')}".rstrip()


def _drop(joint: Element, *tags: str) -> None:
    for part in [part for part in joint if part.tag in tags]:
        joint.remove(part)


def _text(vector: Array) -> str:
    return " ".join(repr(float(number)) for number in vector)
