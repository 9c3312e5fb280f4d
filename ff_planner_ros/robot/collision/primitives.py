"""The solids that have a name and sizes, in one table: whoever asks about a kind asks here."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array

if TYPE_CHECKING:
    import coal

# Radius and half length, or half edges, padded by zeros [m].
Halves: TypeAlias = tuple[float, float, float]


class Kind(enum.IntEnum):
    """Kind of a solid, which selects the formula of distances. The core has the same numbers."""

    ROUND = 0  # all points within a radius of a segment of the z axis: spheres and capsules
    BOX = 1
    CYLINDER = 2
    HULL = 3  # no formula: Coal measures distances
    CONE = 4  # likewise


@dataclass(frozen=True)
class Primitive:
    """A kind of solid that has sizes.

    Cylinders, capsules and cones are about the z axis through their middle, a cone's apex at +z; a
    capsule's length has no caps.
    """

    # Names of its sizes, as in scenarios, URDFs and SDFormat, and how many numbers each has [m]
    sizes: Mapping[str, int]
    message: int  # number in shape_msgs/SolidPrimitive, or in ff_planner_msgs/Obstacle
    geometry: str  # name of Coal's class, which takes the sizes in this order
    formula: Kind

    @property
    def count(self) -> int:
        """How many numbers its sizes have."""
        return sum(self.sizes.values())

    def made(self, *sizes: float) -> coal.CollisionGeometry:
        """Return a solid of these sizes [m]."""
        import coal  # takes half a second to load, and readers of messages need the table alone

        return getattr(coal, self.geometry)(*sizes)


_ROUND = {"radius": 1, "length": 1}
PRIMITIVES: Mapping[str, Primitive] = {
    "sphere": Primitive({"radius": 1}, 2, "Sphere", Kind.ROUND),
    "box": Primitive({"size": 3}, 1, "Box", Kind.BOX),
    "cylinder": Primitive(_ROUND, 3, "Cylinder", Kind.CYLINDER),
    "capsule": Primitive(_ROUND, 101, "Capsule", Kind.ROUND),
    "cone": Primitive(_ROUND, 4, "Cone", Kind.CONE),
}
_NAMES = {one.geometry: name for name, one in PRIMITIVES.items()}


def primitive_of(solid: coal.CollisionGeometry) -> tuple[str, Array] | None:
    """Return name and sizes [m] of a Coal geometry; None: it is a hull."""
    name = _NAMES.get(type(solid).__name__)
    if name is None:
        return None
    halves = np.array(kind_and_sizes(solid)[1])
    is_radius = np.array([word == "radius" for word in PRIMITIVES[name].sizes])
    factors = np.where(is_radius, 1.0, 2.0)
    return name, halves[: PRIMITIVES[name].count] * factors


def kind_and_sizes(solid: coal.CollisionGeometry) -> tuple[Kind, Halves]:
    """Return a solid's kind, and its half edges, or radius and half length, padded by zeros [m]."""
    name = _NAMES.get(type(solid).__name__)
    if name is None:
        return Kind.HULL, (0.0, 0.0, 0.0)
    kind = PRIMITIVES[name].formula
    if kind is Kind.BOX:
        length, width, height = solid.halfSide.tolist()
        return kind, (length, width, height)
    return kind, (solid.radius, getattr(solid, "halfLength", 0.0), 0.0)


def radius_around(solid: coal.CollisionGeometry, center: Array) -> float:
    """Return the radius of a sphere about a solid's centre that holds the solid [m]."""
    kind, halves = kind_and_sizes(solid)
    match kind:
        case Kind.ROUND:
            return halves[1] + halves[0]
        case Kind.BOX:
            return float(np.linalg.norm(halves))
        case Kind.CYLINDER | Kind.CONE:
            return math.hypot(halves[1], halves[0])
    return float(np.linalg.norm(solid.points() - center, axis=1).max())


def furthest(solid: coal.CollisionGeometry, ways: Array) -> Array:
    """Return a solid's support function: the largest coordinate along each direction [m].

    Args:
        ways: Directions in the solid's frame, of unit length. Shape (..., 3).

    Returns:
        One dimension less.
    """
    kind, (radius, half_length, _) = kind_and_sizes(solid)
    up, across = half_length * ways[..., 2], radius * np.hypot(ways[..., 0], ways[..., 1])
    match kind:
        case Kind.ROUND:
            found = np.abs(up) + radius
        case Kind.BOX:
            found = np.abs(ways) @ solid.halfSide
        case Kind.CYLINDER:
            found = np.abs(up) + across
        case Kind.CONE:
            found = np.maximum(up, across - up)
        case _:
            found = (ways @ solid.points().T).max(axis=-1)
    return np.asarray(found + solid.getSweptSphereRadius(), np.float64)
