"""Links that may touch, in an SRDF: `<disable_collisions link1="" link2="" reason=""/>`.

MoveIt has two more elements: `<disable_default_collisions link=""/>` for a link that may touch any
other, and `<enable_collisions link1="" link2=""/>` for a pair that may not touch nevertheless.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterable
from typing import NamedTuple, TypeAlias
from xml.etree.ElementTree import Element, SubElement

from ff_planner_ros.robot.urdf.urdf_faults import Faults, listed
from ff_planner_ros.robot.urdf.urdf_xml import DISABLE, DISABLE_ALL, ENABLE, read_collisions

# The words of MoveIt's assistant.
ADJACENT, ALWAYS, NEVER = "Adjacent", "Always", "Never"

Links: TypeAlias = frozenset[str]  # two of them


class MayTouch(NamedTuple):
    """Two links that may touch, and why."""

    link1: str
    link2: str
    reason: str

    @property
    def links(self) -> Links:
        """Both links, unordered."""
        return frozenset((self.link1, self.link2))


class Srdf(NamedTuple):
    """What an SRDF, or a recorded URDF, says of links that may touch."""

    robot: str  # name of the robot that it is for
    disabled: list[MayTouch]
    # As in MoveIt, a pair that is disabled by name stays disabled even if it is enabled, too
    enabled: set[Links]


def read_srdf(text: str, links: Collection[str], faults: Faults, field: str = "robot.srdf") -> Srdf:
    """Return what an SRDF, or a recorded URDF, says of links that may touch.

    Args:
        links: Names of the robot's links; others are faults.

    Raises:
        InvalidInput: The text is no XML, another document, or too large.
    """
    disabled, enabled, of_any = list[MayTouch](), set[Links](), list[str]()
    robot = read_collisions(text, field, faults)
    for element in robot:
        if element.tag not in (DISABLE, DISABLE_ALL, ENABLE):
            continue  # of an SDF, which says nothing of this
        keys = ("link",) if element.tag == DISABLE_ALL else ("link1", "link2")
        names = [element.get(key, "") for key in keys]
        for name in names:
            if name not in links:
                allowed = f"it must be one of the URDF's links: {listed(links)}"
                faults.add(field, "", f"{element.tag} link", name or "missing", allowed)
        if element.tag == DISABLE:
            disabled.append(MayTouch(names[0], names[1], element.get("reason", "")))
        elif element.tag == ENABLE:
            enabled.add(frozenset(names))
        else:
            of_any += names
    disabled += [
        MayTouch(link, other, DISABLE_ALL)
        for link in of_any
        for other in links
        if frozenset((link, other)) not in enabled
    ]
    return Srdf(robot.get("name", ""), disabled, enabled)


def write_pairs(robot: Element, pairs: Iterable[MayTouch], apart: Iterable[Links] = ()) -> None:
    """Append pairs that may touch to a `<robot>`, and neighbours (`apart`) that may not."""
    for pair in pairs:
        SubElement(robot, DISABLE, pair._asdict())
    for first, second in sorted(map(sorted, apart)):
        SubElement(robot, ENABLE, link1=first, link2=second)


def srdf_text(name: str, pairs: Iterable[MayTouch]) -> str:
    """Return the text of an SRDF for a robot's name with pairs that may touch."""
    robot = Element("robot", name=name)
    write_pairs(robot, pairs)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'
