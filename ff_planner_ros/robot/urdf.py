"""A URDF checked before Pinocchio reads it, so that each fault is named where it lies."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from itertools import islice
from typing import NoReturn
from xml.etree.ElementTree import Element

import numpy as np

from ff_planner_ros.errors import InvalidInput, Status

# Fewer joints cannot place an end effector in every pose.
MIN_JOINTS = 6

# Inertias are written with few digits: for a thin rod, where the triangle inequality holds
# with equality, rounding must not count as a fault.
TRIANGLE_TOLERANCE = 1e-6


def checked_urdf(text: str, base_link: str, tip_link: str) -> str:
    """Return the URDF without shapes, transmissions and simulator tags, checked.

    Raises:
        InvalidInput: Not one chain of at least six revolute joints with limits from the base
            link to the tip link, or an inertia that no body has.
    """
    robot, links, joints, above = _tree(text)
    for field, link in (("robot.base_link", base_link), ("robot.tip_link", tip_link)):
        if link not in links:
            _refuse(field, link, _one_of(links))
    _check_joints(joints, _chain(above, base_link, tip_link))
    masses = {name: _checked_mass(name, link) for name, link in links.items()}
    _check_bodies(masses, above, base_link)
    return ElementTree.tostring(robot, encoding="unicode")


def root_link(text: str) -> str:
    """Return the link that hangs on no other.

    Raises:
        InvalidInput: Not a URDF.
    """
    _, links, _, above = _tree(text)
    return next(link for link in links if link not in above)


def only_leaf_link(text: str) -> str:
    """Return the one link that carries no other.

    Raises:
        InvalidInput: Not a URDF, or several links carry no other.
    """
    _, links, _, above = _tree(text)
    carriers = {_link(joint, "parent") for joint in above.values()}
    leaves = [link for link in links if link not in carriers]
    if len(leaves) != 1:
        _refuse("robot.tip_link", "not given", f"it must be one of {', '.join(leaves)}")
    return leaves[0]


def _tree(
    text: str,
) -> tuple[Element, dict[str, Element], dict[str, Element], dict[str, Element]]:
    """Return robot, links, joints and the joint above each link."""
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        _refuse("robot.urdf", "not XML", str(error))
    if robot.tag != "robot":
        _refuse("robot.urdf", f"a <{robot.tag}>", "its outermost tag must be <robot>")
    robot.attrib.setdefault("name", "robot")
    _strip(robot)
    links = _by_name(robot, "link")
    joints = _by_name(robot, "joint")
    return robot, links, joints, _joint_above_each_link(links, joints)


def _refuse(field: str, value: object, allowed: str) -> NoReturn:
    raise InvalidInput(Status.BAD_ROBOT, field, value, allowed)


def _one_of(links: dict[str, Element]) -> str:
    return f"it must be one of the URDF's links: {', '.join(links)}"


def _strip(robot: Element) -> None:
    """Drop what neither weighs nor moves: a missing mesh shall not stop a plan."""
    for element in list(robot):
        if element.tag not in ("link", "joint"):
            robot.remove(element)
        for part in list(element):
            if part.tag in ("visual", "collision"):
                element.remove(part)


def _by_name(robot: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in robot.findall(tag):
        name = element.get("name")
        if not name:
            _refuse(f"a {tag} of the URDF", "nameless", "it must have a name")
        if name in found:
            _refuse(f"{tag} '{name}'", "there twice", "names must be unique")
        found[name] = element
    return found


def _joint_above_each_link(
    links: dict[str, Element], joints: dict[str, Element]
) -> dict[str, Element]:
    """Check that the links form one tree; the root alone has no joint above it."""
    above: dict[str, Element] = {}
    for name, joint in joints.items():
        for end in ("parent", "child"):
            if _link(joint, end) not in links:
                _refuse(f"joint '{name}' {end}", _link(joint, end) or "missing", _one_of(links))
        child = _link(joint, "child")
        if child in above:
            allowed = f"joint '{above[child].get('name')}' carries that link already"
            _refuse(f"joint '{name}' child", child, allowed)
        above[child] = joint
        for part in ("origin", "axis"):
            _check_vectors(f"joint '{name}'", joint.find(part))
    for link in links:
        if len(list(islice(_upwards(link, above), len(joints) + 1))) > len(joints):
            _refuse(f"link '{link}'", "in a loop of joints", "the links must form a tree")
    roots = [link for link in links if link not in above]
    if len(roots) != 1:
        _refuse("root link", ", ".join(roots) or "missing", "there must be exactly one")
    return above


def _link(joint: Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _upwards(link: str, above: dict[str, Element]) -> Iterator[Element]:
    """Joints from the one above `link` to the one below the root."""
    while link in above:
        yield above[link]
        link = _link(above[link], "parent")


def _chain(above: dict[str, Element], base_link: str, tip_link: str) -> list[Element]:
    chain = []
    for joint in _upwards(tip_link, above):
        chain.append(joint)
        if _link(joint, "parent") == base_link:
            return chain
    _refuse("robot.tip_link", tip_link, f"it must hang on the base link '{base_link}'")


def _check_joints(joints: dict[str, Element], chain: list[Element]) -> None:
    for name, joint in joints.items():
        kind = joint.get("type")
        if kind == "fixed":
            continue
        if kind == "continuous":
            _refuse(f"joint '{name}'", "continuous", "make it revolute and give it limits")
        if kind != "revolute":
            _refuse(f"joint '{name}'", kind or "of no type", "it must be revolute or fixed")
        if joint not in chain:
            _refuse(f"joint '{name}'", "movable but not between base and tip", "make it fixed")
        if joint.find("mimic") is not None:
            _refuse(f"joint '{name}'", "a mimic", "every joint of the arm must move by itself")
        axis = joint.find("axis")
        if axis is not None and not np.any(_vector(f"joint '{name}' axis", axis.get("xyz", ""))):
            _refuse(f"joint '{name}' axis", axis.get("xyz"), "it must have a direction")
        _check_limits(name, joint)
    arm = [joint for joint in chain if joint.get("type") == "revolute"]
    if len(arm) < MIN_JOINTS:
        _refuse("number of joints from base to tip", len(arm), f"it must be at least {MIN_JOINTS}")


def _check_limits(name: str, joint: Element) -> None:
    limit = joint.find("limit")
    if limit is None:
        _refuse(f"joint '{name}' limit", "missing", "it needs lower, upper, velocity and effort")
    lower, upper, velocity, effort = (
        _number(f"joint '{name}' limit {key}", limit, key)
        for key in ("lower", "upper", "velocity", "effort")
    )
    if lower >= upper:
        _refuse(f"joint '{name}' limit lower", lower, f"it must be below upper, {upper:g}")
    if velocity <= 0.0:
        _refuse(f"joint '{name}' limit velocity", velocity, "it must be greater than zero")
    if effort < 0.0:
        _refuse(f"joint '{name}' limit effort", effort, "it must not be negative; 0 means unknown")


def _checked_mass(name: str, link: Element) -> float:
    """Mass of one link, its inertia checked; zero for a link that is only a frame."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0
    _check_vectors(f"link '{name}' inertial", inertial.find("origin"))
    mass = _number(f"link '{name}' mass", inertial.find("mass"), "value")
    entries = {
        key: _number(f"link '{name}' inertia {key}", inertial.find("inertia"), key)
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    }
    if mass < 0.0:
        _refuse(f"link '{name}' mass", mass, "it must not be negative")
    if mass == 0.0:
        if any(entries.values()):
            _refuse(f"link '{name}' mass", mass, "it must be positive: the link has an inertia")
        link.remove(inertial)
        return 0.0
    matrix = [
        [entries["ixx"], entries["ixy"], entries["ixz"]],
        [entries["ixy"], entries["iyy"], entries["iyz"]],
        [entries["ixz"], entries["iyz"], entries["izz"]],
    ]
    smallest, middle, largest = np.linalg.eigvalsh(matrix)
    principal = f"of principal moments {smallest:.6g}, {middle:.6g}, {largest:.6g}"
    if smallest <= 0.0:
        _refuse(f"link '{name}' inertia", principal, "all three must be positive")
    if largest > (smallest + middle) * (1.0 + TRIANGLE_TOLERANCE):
        allowed = "the largest must not exceed the sum of the others"
        _refuse(f"link '{name}' inertia", principal, allowed)
    return mass


def _check_bodies(masses: dict[str, float], above: dict[str, Element], base_link: str) -> None:
    """Check that the base and every moving link, with what is fixed to them, have mass."""
    moving = [_link(joint, "child") for joint in above.values() if joint.get("type") != "fixed"]
    body_masses = dict.fromkeys([base_link, *moving], 0.0)
    for link, mass in masses.items():
        carriers = (j for j in _upwards(link, above) if j.get("type") != "fixed")
        carrier = next(carriers, None)
        body_masses[base_link if carrier is None else _link(carrier, "child")] += mass
    for link, mass in body_masses.items():
        if mass == 0.0:
            allowed = "a link that moves must have mass, its own or of links fixed to it"
            _refuse(f"link '{link}' mass", mass, allowed)


def _check_vectors(owner: str, element: Element | None) -> None:
    """Check the `xyz` and `rpy` of an origin or axis, and write them back as they were read."""
    if element is not None:
        for key in ("xyz", "rpy"):
            if key in element.attrib:
                numbers = _vector(f"{owner} {element.tag} {key}", element.attrib[key])
                element.set(key, " ".join(map(repr, numbers)))


def _vector(field: str, text: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        _refuse(field, repr(text), "it must be three finite numbers")
    return numbers


def _number(field: str, element: Element | None, key: str) -> float:
    """Read a number and write it back, so that Pinocchio reads the one that was checked."""
    text = None if element is None else element.get(key)
    if element is None or text is None:
        _refuse(field, "missing", "it must be a number")
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        _refuse(field, repr(text), "it must be a finite number")
    element.set(key, repr(number))
    return number
