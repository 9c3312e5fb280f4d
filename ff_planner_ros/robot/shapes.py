"""The shapes that a robot is drawn with: the primitives of its URDF's links.

Nothing here can refuse a robot. A shape that cannot be read is left out: no plan depends on it.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.rotation import rotation_from_euler

# A link is drawn by what it looks like, or else by what it collides with.
_TAGS = ("visual", "collision")
# More shapes than this are a landscape and no robot; nothing larger than this [m] is in orbit.
_MOST_SHAPES, _LARGEST = 1000, 1e4


@dataclass(frozen=True, eq=False)
class Shape:
    """A drawn solid that is fixed to a link."""

    link: str
    kind: str  # of `PRIMITIVES`
    sizes: tuple[float, ...]  # in that order [m]
    position_in_link: Array  # of its centre; shape (3,) [m]
    rotation_to_link: Array  # shape (3, 3)


def with_shapes(checked: str, original: Element) -> str:
    """Return a checked URDF, which has no shapes, with the drawn ones of its original `<robot>`."""
    robot = ElementTree.fromstring(checked)
    given = {str(link.get("name")): link for link in original.findall("link")}
    left = _MOST_SHAPES
    for link in robot.findall("link"):
        for element in _drawn(given.get(str(link.get("name")), link))[:left]:
            link.append(_copied(element))
            left -= 1
    return ElementTree.tostring(robot, encoding="unicode")


def link_shapes(urdf: str) -> tuple[Shape, ...]:
    """Return the drawn shapes of all links of a URDF."""
    return tuple(
        shape
        for link in ElementTree.fromstring(urdf).findall("link")
        for element in _drawn(link)
        if (shape := _shape(str(link.get("name")), element)) is not None
    )


def _drawn(link: Element) -> list[Element]:
    """Return the `<visual>` elements of a link that can be drawn, or else its `<collision>`s."""
    for tag in _TAGS:
        found = [element for element in link.findall(tag) if _shape("", element) is not None]
        if found:
            return found
    return []


def _shape(link: str, element: Element) -> Shape | None:
    """Read a shape; None: a mesh, or nothing that can be drawn."""
    for kind, primitive in PRIMITIVES.items():
        solid = element.find(f"geometry/{kind}")
        if solid is None:
            continue
        sizes = tuple(
            number for name in primitive.sizes for number in _numbers(solid.get(name, ""))
        )
        origin = element.find("origin")
        position, angles = (
            _numbers("0 0 0" if origin is None else origin.get(name, "0 0 0"))
            for name in ("xyz", "rpy")
        )
        if (
            len(sizes) != primitive.count
            or min(sizes) <= 0.0
            or not len(position) == len(angles) == 3
        ):
            return None
        rotation = rotation_from_euler(np.array(angles))
        return Shape(link, kind, sizes, frozen(position), frozen(rotation))
    return None


def _numbers(text: str) -> list[float]:
    """Return the numbers of a text; none if one of its words is no finite, sensible number."""
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        return []
    return found if all(math.isfinite(x) and abs(x) <= _LARGEST for x in found) else []


def _copied(element: Element) -> Element:
    """Return a shape as a `<visual>` element, without names, materials and files."""
    visual = Element("visual")
    visual.extend(_parts(element))
    return visual


def _parts(element: Element) -> Iterator[Element]:
    origin = element.find("origin")
    if origin is not None:
        yield Element("origin", _as_read(origin, [k for k in ("xyz", "rpy") if k in origin.attrib]))
    for kind, primitive in PRIMITIVES.items():
        solid = element.find(f"geometry/{kind}")
        if solid is not None:
            geometry = Element("geometry")
            geometry.append(Element(kind, _as_read(solid, primitive.sizes)))
            yield geometry
            return


def _as_read(element: Element, names: Iterable[str]) -> dict[str, str]:
    return {name: " ".join(map(repr, _numbers(element.get(name, "")))) for name in names}
