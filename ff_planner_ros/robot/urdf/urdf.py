"""The check of a URDF before Pinocchio reads it, so that errors name each fault and its place."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

import pinocchio as pin

from ff_planner_ros.robot.urdf.locked_joints import (
    NOTHING_HELD,
    Drive,
    LockedJoint,
    drop,
    has_axis,
    lock,
    locked_and_driven,
    locked_joints_in,
    make_fixed,
    told_position,
    without_mimicked,
)
from ff_planner_ros.robot.urdf.urdf_bodies import SMALLEST, check_bodies, placement
from ff_planner_ros.robot.urdf.urdf_faults import (
    LARGEST,
    LONGEST_NOTE,
    Faults,
    InertiaChoice,
    listed,
    shortened,
)
from ff_planner_ros.robot.urdf.urdf_tree import Tree, link_of, not_counted, one_of, tree_of
from ff_planner_ros.robot.urdf.urdf_xml import (
    LOCKED,
    inertia_choice,
    read_elements,
)

# The planner's bound of continuous joints, either way from the turn of the start [rad].
TURN_OF_CONTINUOUS = 4.0 * math.pi

_LOCKED = "robot.locked_joints"
_NO_ARM = "it is the base link, and a robot has joints between the two; a body has none"

# Velocity limit that stands for none [rad/s, m/s]: every reader of URDFs wants a number.
NO_VELOCITY_LIMIT = LARGEST

_ENDS = ("lower", "upper")


class CheckedUrdf(NamedTuple):
    """A URDF that passed the check, with its base and tip link."""

    xml: str  # links and joints, without shapes, transmissions and simulator tags
    base_link: str
    tip_link: str
    notes: tuple[str, ...]  # for the user: joints that are locked, say
    locked_joints: tuple[LockedJoint, ...]
    driven: Mapping[str, Drive]  # joints that planned ones drive
    path: tuple[str, ...]  # joints from the root to the tip


def checked_urdf(
    text: str,
    base_link: str | None = None,
    tip_link: str | None = None,
    held_at: Mapping[str, float] = NOTHING_HELD,
    holds_slides: bool = False,
    inertia: InertiaChoice = InertiaChoice.POSSIBLE,
) -> CheckedUrdf:
    """Check a URDF, and return it reduced to links and joints, with all but the arm's joints fixed.

    The arm's joints are the revolute and prismatic ones between base and tip, and those that mimic
    one of these. All others, those of a gripper or of another arm, become fixed joints, at zero or
    at the limit nearest to zero.

    Args:
        base_link: None: the root.
        tip_link: None: the only link that moves and carries no other.
        held_at: Positions of joints that are locked [rad, m]; they may be in the arm.
        holds_slides: Prismatic joints of the arm are locked, too.
        inertia: What happens to impossible inertias; `POSSIBLE`: what a recorded URDF says.

    Raises:
        InvalidInput: No chain of movable joints leads from base link to tip link, or the URDF is
            otherwise faulty. The error tells all faults.
    """
    faults = Faults()
    robot = read_elements(text, faults)
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
    notes, moving, locked = faults.notes, list[Element](), list[LockedJoint]()
    driven = dict[str, Drive]()
    if chain is not None:
        locked_kinds = ("fixed", "prismatic") if holds_slides else ("fixed",)
        moving = [
            joint
            for joint in chain
            if joint.get("type") not in locked_kinds and _name(joint) not in held_at
        ]
        names = {_name(joint) for joint in tree.above.values()}
        along = [j for j in moving for mimic in j.iter("mimic") if mimic.get("joint") in names]
        moving = [joint for joint in moving if joint not in along]
        notes += _check_joints(
            tree, moving, base_link or "", placements, held_at, locked, driven, faults
        )
        notes += _check_driven(tree, moving, along, driven, faults)
    choice = inertia_choice(robot, inertia, faults)
    notes += check_bodies(tree, placements, base_link or "", faults, choice)
    faults.refuse_if_any()
    notes += not_counted(moving, text)
    ElementTree.indent(robot)
    xml = ElementTree.tostring(robot, encoding="unicode")
    told = tip_link or ""
    path = [_name(joint) for joint in tree.upwards(told)]
    return CheckedUrdf(xml, base_link or "", told, tuple(notes), tuple(locked), driven, tuple(path))


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
        hung = f"it must hang on the base link {shortened(base_link)!r}"
        faults.add("robot.tip_link", "", "", tip_link, _NO_ARM if base_link == tip_link else hung)
    return chain


def _check_joints(
    tree: Tree,
    moving: Sequence[Element],
    base_link: str,
    placements: dict[str, pin.SE3 | None],
    held_at: Mapping[str, float],
    locked: list[LockedJoint],
    driven: dict[str, Drive],
    faults: Faults,
) -> list[str]:
    """Check the joints of the arm that move, fix all others, and return notes on these.

    Args:
        locked: Gets the joints that are fixed.
        driven: Gets the joints that move along with planned ones.
    """
    for arm_joint in moving:
        _check_arm_joint(_name(arm_joint), arm_joint, faults)
    if not moving:
        allowed = "at least one must turn or slide between base and tip"
        faults.add("number of joints from base to tip", "", "", 0, allowed)
    joints = {_name(joint): joint for joint in tree.above.values()}
    alone = without_mimicked(joints)
    where, drives = locked_and_driven(joints, [*map(_name, moving)], held_at, _LOCKED, faults)
    driven |= drives
    locked += locked_joints_in(joints, where)
    # Links that move with the tip, and all that they carry.
    under_base = {link_of(joint, "child") for joint in tree.upwards(base_link)}
    first = link_of(moving[-1], "child") if moving else tree.order[0]
    beyond: set[str] = {first}
    held, held_elsewhere = list[str](), list[str]()
    for link in tree.order:
        joint = tree.above.get(link)
        if joint is None or joint in moving:
            continue
        if link_of(joint, "parent") in beyond:
            beyond.add(link)
        if _name(joint) in driven and link not in under_base:
            continue
        if joint.get("type") == "fixed":
            drop(joint, "axis", "limit", "mimic", LOCKED)
        elif link in under_base:
            value = "movable and carries the base link"
            faults.add("joint", _name(joint), "", value, "make it fixed")
            joint.set("type", "fixed")  # what it carries has no fault of its own
        else:
            at, place = where.get(_name(joint), 0.0), placements[link]
            told = held if link in beyond else held_elsewhere
            told.append(told_position(joint, at))
            placements[link] = lock(joint, at, place, faults)
            make_fixed(joint, placements[link] if at else None)
    reasons = {
        "the end effector carries them": held,
        "they do not belong to the arm, or are to be held": held_elsewhere,
    }
    notes = [
        f"held, because {why}: {listed(of, LONGEST_NOTE)}" for why, of in reasons.items() if of
    ]
    return [*notes, *alone]


def _check_driven(
    tree: Tree,
    moving: Sequence[Element],
    along: Sequence[Element],
    driven: Mapping[str, Drive],
    faults: Faults,
) -> list[str]:
    """Check joints that planned ones drive, narrow the limits of these, and return notes.

    Args:
        along: Those of the arm, from base to tip.
    """
    arm = {_name(joint): joint for joint in moving}
    order = [_name(joint) for joint in tree.upwards(link_of(along[-1], "child"))] if along else []
    told, narrowed, apart = list[str](), dict[str, list[str]](), list[str]()
    for link in tree.order:
        joint = tree.above.get(link)
        if joint is None or (drive := driven.get(name := _name(joint))) is None:
            continue
        _check_moving(name, joint, faults)
        if joint in along and drive.of not in order[order.index(name) :]:
            allowed = f"it must be the other way round: {drive.of} is further from the base"
            faults.add("joint", name, "", f"a mimic of {drive.of}", allowed)
        drop(joint, "mimic")
        of, multiplier, along_with = drive.of, repr(drive.multiplier), repr(drive.offset)
        SubElement(joint, "mimic", joint=of, multiplier=multiplier, offset=along_with)
        offset = f" {drive.offset:+g}" if drive.offset else ""
        told.append(f"{name} at {drive.multiplier:g} {of}{offset}")
        if not len(faults) and _narrow(arm[of], joint, drive, apart):
            narrowed.setdefault(of, []).append(name)
    notes = [f"moved along: {listed(told, LONGEST_NOTE)}"] if told else []
    if apart:
        why = "which are not kept, as what they mimic cannot reach them"
        notes.append(f"limits of joints, {why}: {listed(apart, LONGEST_NOTE)}")
    for name, by in narrowed.items():
        unit = "m" if arm[name].get("type") == "prismatic" else "rad"
        lower, upper, rate = (
            f"{float(_limit(arm[name]).get(key, '')):g}" for key in (*_ENDS, "velocity")
        )
        kept = f"{lower} to {upper} {unit} and {rate} {unit}/s"
        notes.append(f"limits of {name} are {kept}, for what it moves along: {listed(by)}")
    return notes


def _narrow(arm_joint: Element, joint: Element, drive: Drive, apart: list[str]) -> bool:
    """Let a joint of the arm keep the limits of one that it drives; tell whether they change.

    A joint that turns without end has a first turn if it drives others: they may not be where they
    were a turn before. Of one that cannot keep its limits, as grippers are published, `apart` gets
    the name: no reader of URDFs keeps limits of mimics.
    """
    kept, own = _limit(arm_joint), _limit(joint)
    told = dict(kept.items())
    if arm_joint.get("type") == "continuous":
        arm_joint.set("type", "revolute")
    if joint.get("type") != "continuous":
        ends = sorted((float(own.get(end, "")) - drive.offset) / drive.multiplier for end in _ENDS)
        lower = max(ends[0], float(kept.get("lower", "")))
        upper = min(ends[1], float(kept.get("upper", "")))
        if lower >= upper:
            apart.append(_name(joint))
        else:
            kept.set("lower", repr(lower))
            kept.set("upper", repr(upper))
    rate = min(float(own.get("velocity", "")) / abs(drive.multiplier), float(told["velocity"]))
    kept.set("velocity", repr(rate))
    return any(float(kept.get(key, "")) != float(text) for key, text in told.items())


def _limit(joint: Element) -> Element:
    return next(joint.iter("limit"))


def _check_arm_joint(name: str, joint: Element, faults: Faults) -> None:
    if joint.find("mimic") is not None:
        faults.add("joint", name, "", "a mimic", "the joint that it mimics is not there")
    _check_moving(name, joint, faults)


def _check_moving(name: str, joint: Element, faults: Faults) -> None:
    kind = joint.get("type")
    if kind == "continuous":
        _limit_continuous(joint)
        _check_limits(name, joint, faults)
    elif kind and kind not in ("revolute", "prismatic"):
        faults.add("joint", name, "", kind, "it must be revolute, prismatic or fixed")
    else:
        _check_limits(name, joint, faults)
    has_axis(joint, faults)


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
    if limit is None:  # by the format, it may be left out
        limit = SubElement(joint, "limit", velocity=repr(NO_VELOCITY_LIMIT), effort="0")
    limit.set("lower", repr(-TURN_OF_CONTINUOUS))
    limit.set("upper", repr(TURN_OF_CONTINUOUS))
