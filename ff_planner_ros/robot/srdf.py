"""Links that may touch, as an SRDF says it: `<disable_collisions link1="" link2="" reason=""/>`."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterable
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement

from ff_planner_ros.robot.urdf_faults import Faults, listed
from ff_planner_ros.robot.urdf_xml import DISABLE, read_disabled

# The words of MoveIt's assistant.
ADJACENT, ALWAYS, NEVER = "Adjacent", "Always", "Never"


class MayTouch(NamedTuple):
    """Two links that may touch, and why."""

    link1: str
    link2: str
    reason: str

    @property
    def links(self) -> frozenset[str]:
        """The two, in no order."""
        return frozenset((self.link1, self.link2))


def read_srdf(
    text: str, links: Collection[str], faults: Faults, field: str = "robot.srdf"
) -> list[MayTouch]:
    """Return the pairs that an SRDF, or a recorded URDF, disables.

    Args:
        links: Of the robot; others are faults.

    Raises:
        InvalidInput: It is no XML, or too large.
    """
    found = []
    for element in read_disabled(text, field):
        pair = MayTouch(*(element.get(name, "") for name in ("link1", "link2", "reason")))
        for name in pair[:2]:
            if name not in links:
                allowed = f"it must be one of the URDF's links: {listed(links)}"
                faults.add(field, "", f"{DISABLE} link", name or "missing", allowed)
        found.append(pair)
    return found


def write_pairs(robot: Element, pairs: Iterable[MayTouch]) -> None:
    """Append pairs to a `<robot>`."""
    for pair in pairs:
        SubElement(robot, DISABLE, pair._asdict())


def srdf_text(name: str, pairs: Iterable[MayTouch]) -> str:
    """Return an SRDF."""
    robot = Element("robot", name=name)
    write_pairs(robot, pairs)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'
