"""The links and joints of a URDF as a tree, a chain in it, and what else the URDF says of that."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from ff_planner_ros.robot.urdf.urdf_faults import (
    LONGEST_NOTE,
    Faults,
    finite_numbers,
    listed,
    shortened,
)
from ff_planner_ros.robot.urdf.urdf_xml import read_shapes

_LONGEST_NAME = 200  # characters: names travel in every state and every plan


@dataclass(frozen=True)
class Tree:
    """Links and joints by name; faulty ones are left out."""

    links: dict[str, Element]
    joints: dict[str, Element]
    above: dict[str, Element]  # the joint above each link
    order: tuple[str, ...]  # links, each after the one that carries it; none that is in a loop

    @property
    def roots(self) -> list[str]:
        """Links that no other carries."""
        return [link for link in self.links if link not in self.above]

    @property
    def leaves(self) -> list[str]:
        """Links that carry no other."""
        carriers = {link_of(joint, "parent") for joint in self.above.values()}
        return [link for link in self.links if link not in carriers]

    def chain(self, base_link: str, tip_link: str) -> list[Element] | None:
        """Return the joints from base to tip, in order; None: the base does not carry the tip."""
        chain: list[Element] = []
        for joint in self.upwards(tip_link):
            chain.insert(0, joint)
            if link_of(joint, "parent") == base_link:
                return chain
        return None

    def upwards(self, link: str) -> Iterator[Element]:
        """Yield the joints from the one above a link to the one below the root."""
        for _ in range(len(self.links)):  # more steps than that are a loop
            if link not in self.above:
                return
            yield self.above[link]
            link = link_of(self.above[link], "parent")


def tree_of(robot: Element, faults: Faults) -> Tree:
    """Return the tree of a `<robot>`; whatever makes it no tree is added to `faults`."""
    links, joints = (_by_name(robot, tag, faults) for tag in ("link", "joint"))
    if not links:
        allowed = "it must have links; a xacro file has to be expanded first"
        faults.add("robot.urdf", "", "", "without links", allowed)
    above: dict[str, Element] = {}
    for name, joint in joints.items():
        _hang_up(name, joint, links, above, faults)
    order = _from_the_root(links, above)
    # A link below a faulty joint is no root: the joint's fault is enough.
    children = {link_of(joint, "child") for joint in robot.findall("joint")}
    roots = [link for link in links if link not in children]
    if len(roots) > 1:
        faults.add("root link", "", "", listed(roots), "there must be exactly one")
    looped = links.keys() - set(order)
    for link in links:
        if link in looped:
            allowed = "the links must form a tree"
            faults.add("link", link, "", "in a loop of joints, or hangs on one", allowed)
    return Tree(links, joints, above, order)


def link_of(joint: Element, end: str) -> str:
    """Return the link at one end of a joint, `parent` or `child`; empty: none is named."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def one_of(links: dict[str, Element]) -> str:
    """Return the words of an error that lists the links."""
    return f"it must be one of the URDF's links: {listed(links)}"


def _by_name(robot: Element, tag: str, faults: Faults) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for number, element in enumerate(robot.findall(tag), start=1):
        name = element.get("name")
        if not name:
            faults.add(tag, "", f"number {number}", "nameless", "it must have a name", element)
        elif len(name) > _LONGEST_NAME:
            value = f"a name of {len(name)} characters"
            faults.add(tag, name, "", value, f"it must have at most {_LONGEST_NAME}", element)
        elif name in found:
            faults.add(tag, name, "", "there twice", "names must be unique", element)
        else:
            found[name] = element
    return found


def _hang_up(
    name: str, joint: Element, links: dict[str, Element], above: dict[str, Element], faults: Faults
) -> None:
    """Store a joint as the one above its child link, or add its faults."""
    parent, child = (link_of(joint, end) for end in ("parent", "child"))
    sound = True
    if not joint.get("type"):
        faults.add("joint", name, "", "of no type", "it must be revolute, prismatic or fixed")
    for end, link in (("parent", parent), ("child", child)):
        if link not in links:
            faults.add("joint", name, end, link or "missing", one_of(links))
            sound = False
    if child in above:
        carrier = shortened(above[child].get("name", ""))
        allowed = f"joint {carrier!r} carries that link already"
        faults.add("joint", name, "child", child, allowed)
    elif sound:
        above[child] = joint


def _from_the_root(links: dict[str, Element], above: dict[str, Element]) -> tuple[str, ...]:
    """Return links, each after the one that carries it."""
    carried: dict[str, list[str]] = {link: [] for link in links}
    for link, joint in above.items():
        carried[link_of(joint, "parent")].append(link)
    order = [link for link in links if link not in above]
    for link in order:  # grows
        order.extend(carried[link])
    return tuple(order)


def as_revolute(xml: str) -> tuple[str, list[str]]:
    """Return a URDF with continuous joints as revolute ones, and their names.

    Pinocchio has two numbers for the position of a continuous joint.
    """
    robot = ElementTree.fromstring(xml)
    endless = robot.findall("joint[@type='continuous']")
    for joint in endless:
        joint.set("type", "revolute")
    told = ElementTree.tostring(robot, encoding="unicode") if endless else xml
    return told, [joint.get("name", "") for joint in endless]


def not_counted(moving: Sequence[Element], text: str) -> list[str]:
    """Return notes on what else a URDF says of the joints that move, and no plan counts."""
    given = read_shapes(text)
    commands = [
        (joint.get("name", ""), one)
        for joint in given.iterfind("ros2_control/joint")
        for one in joint.iterfind("command_interface")
        if not any(limits.get("enable") == "false" for limits in (*joint, *one))
    ]
    written = {joint.get("name", ""): joint for joint in given.iterfind("joint")}
    soft, beyond, controlled, resisting = list[str](), list[str](), list[str](), list[str]()
    for joint in moving:
        name, kept = joint.get("name", ""), _Kept(joint)
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
        f"{joint.get('name', '')} mimics {(one.text or '').strip()}"
        for joint in given.iterfind("ros2_control/joint")
        for one in joint.iterfind("param[@name='mimic']")
        if written.get(joint.get("name", ""), joint).find("mimic") is None
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
        self._name = joint.get("name", "")
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
