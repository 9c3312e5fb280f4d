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
    LockedJoint,
    has_axis,
    lock,
    locked_joints_in,
    locked_positions,
    told_position,
    without_mimicked,
)
from ff_planner_ros.robot.urdf.urdf_bodies import (
    SMALLEST,
    check_bodies,
    placement,
)
from ff_planner_ros.robot.urdf.urdf_faults import (
    LARGEST,
    LONGEST_NOTE,
    Faults,
    finite_numbers,
    listed,
    shortened,
)
from ff_planner_ros.robot.urdf.urdf_tree import Tree, link_of, one_of, tree_of
from ff_planner_ros.robot.urdf.urdf_xml import (
    LOCKED,
    InertiaChoice,
    inertia_choice,
    read_elements,
    read_shapes,
)

# The planner's bound of continuous joints, either way from the turn of the start [rad].
TURN_OF_CONTINUOUS = 4.0 * math.pi

_LOCKED = "robot.locked_joints"

# Velocity limit that stands for none [rad/s, m/s]: every reader of URDFs wants a number.
NO_VELOCITY_LIMIT = LARGEST


class CheckedUrdf(NamedTuple):
    """A URDF that passed the check, with its base and tip link."""

    xml: str  # links and joints, without shapes, transmissions and simulator tags
    base_link: str
    tip_link: str
    notes: tuple[str, ...]  # for the user: joints that are locked, say
    locked_joints: tuple[LockedJoint, ...]


def checked_urdf(
    text: str,
    base_link: str | None = None,
    tip_link: str | None = None,
    held_at: Mapping[str, float] = NOTHING_HELD,
    holds_slides: bool = False,
    inertia: InertiaChoice = InertiaChoice.POSSIBLE,
) -> CheckedUrdf:
    """Check a URDF, and return it reduced to links and joints, with all but the arm's joints fixed.

    The arm's joints are the revolute and prismatic ones between base and tip. All others, those of
    a gripper or of another arm, become fixed joints, at zero or at the limit nearest to zero.

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
    if chain is not None:
        locked_kinds = ("fixed", "prismatic") if holds_slides else ("fixed",)
        moving = [
            joint
            for joint in chain
            if joint.get("type") not in locked_kinds and _name(joint) not in held_at
        ]
        notes += _check_joints(tree, moving, base_link or "", placements, held_at, locked, faults)
    choice = inertia_choice(robot, inertia, faults)
    notes += check_bodies(tree, placements, base_link or "", faults, choice)
    faults.refuse_if_any()
    notes += _not_counted(moving, text)
    ElementTree.indent(robot)
    xml = ElementTree.tostring(robot, encoding="unicode")
    return CheckedUrdf(xml, base_link or "", tip_link or "", tuple(notes), tuple(locked))


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
    if base_link == tip_link:
        allowed = "it is the base link, and a robot has joints between the two; a body has none"
        faults.add("robot.tip_link", "", "", tip_link, allowed)
    elif chain is None and not broken:
        allowed = f"it must hang on the base link {shortened(base_link)!r}"
        faults.add("robot.tip_link", "", "", tip_link, allowed)
    return chain


def _check_joints(
    tree: Tree,
    moving: Sequence[Element],
    base_link: str,
    placements: dict[str, pin.SE3 | None],
    held_at: Mapping[str, float],
    locked: list[LockedJoint],
    faults: Faults,
) -> list[str]:
    """Check the joints of the arm that move, fix all others, and return notes on these.

    Args:
        locked: Gets the joints that are fixed.
    """
    for arm_joint in moving:
        _check_arm_joint(_name(arm_joint), arm_joint, faults)
    if not moving:
        allowed = "at least one must turn or slide between base and tip"
        faults.add("number of joints from base to tip", "", "", 0, allowed)
    joints = {_name(joint): joint for joint in tree.above.values()}
    alone = without_mimicked(joints)
    where = locked_positions(joints, [*map(_name, moving)], held_at, _LOCKED, faults)
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
        if joint.get("type") == "fixed":
            _drop(joint, "axis", "limit", "mimic", LOCKED)
        elif link in under_base:
            value = "movable and carries the base link"
            faults.add("joint", _name(joint), "", value, "make it fixed")
            joint.set("type", "fixed")  # what it carries has no fault of its own
        else:
            at, place = where.get(_name(joint), 0.0), placements[link]
            told = held if link in beyond else held_elsewhere
            told.append(told_position(joint, at))
            placements[link] = lock(joint, at, place, faults)
            _make_fixed(joint, placements[link] if at else None)
    reasons = {
        "the end effector carries them": held,
        "they do not belong to the arm, or are to be held": held_elsewhere,
    }
    notes = [
        f"held, because {why}: {listed(of, LONGEST_NOTE)}" for why, of in reasons.items() if of
    ]
    return [*notes, *alone]


def _check_arm_joint(name: str, joint: Element, faults: Faults) -> None:
    kind = joint.get("type")
    if joint.find("mimic") is not None:
        faults.add("joint", name, "", "a mimic", "every joint of the arm must move by itself")
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


def _not_counted(moving: Sequence[Element], text: str) -> list[str]:
    """Return notes on what else a URDF says of the joints that move, and no plan counts."""
    given = read_shapes(text)
    commands = [
        (_name(joint), one)
        for joint in given.iterfind("ros2_control/joint")
        for one in joint.iterfind("command_interface")
        if not any(limits.get("enable") == "false" for limits in (*joint, *one))
    ]
    written = {_name(joint): joint for joint in given.iterfind("joint")}
    soft, beyond, controlled, resisting = list[str](), list[str](), list[str](), list[str]()
    for joint in moving:
        name, kept = _name(joint), _Kept(joint)
        own = written[name]
        if (safety := own.find("safety_controller")) is not None:
            at_most = (safety.get(f"soft_{end}_limit", "") for end in ("lower", "upper"))
            soft += kept.stricter("position", *at_most)
        if own.get("type") == "continuous" and (limit := own.find("limit")) is not None:
            beyond += kept.stricter("position", limit.get("lower", ""), limit.get("upper", ""))
        for interface in (one for of, one in commands if of == name):
            ends = {one.get("name"): one.text or "" for one in interface}
            at_most = (ends.get(end, "") for end in ("min", "max"))
            controlled += kept.stricter(interface.get("name", ""), *at_most)
        if (dynamics := own.find("dynamics")) is not None:
            resisting += kept.resisting(dynamics)
    mimics = [
        f"{_name(joint)} mimics {(one.text or '').strip()}"
        for joint in given.iterfind("ros2_control/joint")
        for one in joint.iterfind("param[@name='mimic']")
        if written.get(_name(joint), joint).find("mimic") is None
    ]
    told = {
        "joints that mimic another in <ros2_control> alone, which is not modelled": mimics,
        "stricter limits in <safety_controller>, which are not kept": soft,
        "stricter limits in <ros2_control>, which are not kept": controlled,
        "limits of continuous joints, which are not kept": beyond,
        "not counted in the torques of joints": resisting,
    }
    return [f"{what}: {listed(which, LONGEST_NOTE)}" for what, which in told.items() if which]


class _Kept:
    """The limits that plans keep of a joint."""

    def __init__(self, joint: Element) -> None:
        limit = joint.find("limit")
        told = {} if limit is None else {key: float(text) for key, text in limit.items()}
        effort = told.get("effort", 0.0) or math.inf  # zero means unknown
        rate = told.get("velocity", math.inf)
        position = told.get("lower", -math.inf), told.get("upper", math.inf)
        self._name = _name(joint)
        self._unit, self._force = ("m", "N") if joint.get("type") == "prismatic" else ("rad", "N m")
        self._limits = {
            "position": (*position, self._unit),
            "velocity": (-rate, rate, f"{self._unit}/s"),
            "acceleration": (-math.inf, math.inf, f"{self._unit}/s2"),
            "effort": (-effort, effort, self._force),
        }

    def stricter(self, kind: str, low: str, high: str) -> list[str]:
        """Return limits within those kept, as text; empty: they are none, or no numbers."""
        if kind not in self._limits:
            return []
        lower, upper, unit = self._limits[kind]
        least, most = (finite_numbers(text) for text in (low, high))
        ends = (*least, lower)[0], (*most, upper)[0]
        if not ends[0] < ends[1] or not (ends[0] > lower or ends[1] < upper):
            return []
        return [f"{self._name} {kind} from {ends[0]:g} to {ends[1]:g} {unit}"]

    def resisting(self, dynamics: Element) -> list[str]:
        """Return damping, friction and stiffness of a joint as text, but for those of zero."""
        force, unit = self._force, self._unit
        units = {"damping": f"{force} s/{unit}", "friction": force, "stiffness": f"{force}/{unit}"}
        found = {key: finite_numbers(dynamics.get(key, "")) for key in units}
        told = [f"{key} {one[0]:g} {units[key]}" for key, one in found.items() if one and one[0]]
        return [f"{self._name} {', '.join(told)}"] if told else []


def _make_fixed(joint: Element, place: pin.SE3 | None) -> None:
    """Make a joint a fixed one, whose link is elsewhere than its origin says if that is given."""
    joint.set("type", "fixed")
    _drop(joint, "axis", "limit", "mimic")
    if place is not None:
        _drop(joint, "origin")
        numbers = place.translation, pin.rpy.matrixToRpy(place.rotation)
        xyz, rpy = (" ".join(map(repr, vector.tolist())) for vector in numbers)
        SubElement(joint, "origin", xyz=xyz, rpy=rpy)


def _drop(joint: Element, *tags: str) -> None:
    for part in [part for part in joint if part.tag in tags]:
        joint.remove(part)
