"""Which bodies of a robot must not touch each other."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from typing import TypeAlias
from xml.etree.ElementTree import Element

from ff_planner_ros.robot.bodies import Body
from ff_planner_ros.robot.urdf_tree import link_of

Links: TypeAlias = frozenset[str]  # two of them


def pairs_of(bodies: Sequence[Body], may_touch: Collection[Links]) -> tuple[tuple[int, int], ...]:
    """Return the pairs that move against each other, without those of links that may touch."""
    return tuple(
        (first, second)
        for first, second in itertools.combinations(range(len(bodies)), 2)
        if bodies[first].joint != bodies[second].joint
        and frozenset((bodies[first].link, bodies[second].link)) not in may_touch
    )


def neighbours(robot: Element, bodies: Sequence[Body]) -> set[Links]:
    """Return links that are next to each other in the tree; links without a solid do not count."""
    above = {link_of(joint, "child"): link_of(joint, "parent") for joint in robot.findall("joint")}
    solid = {body.link for body in bodies}
    found: set[Links] = set()
    for link in solid:
        carrier = above.get(link)
        while carrier is not None and carrier not in solid:
            carrier = above.get(carrier)
        if carrier is not None:
            found.add(frozenset((link, carrier)))
    return found
