"""The collision bodies of a robot, from the `<collision>` elements of its URDF."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen, zero_vector
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.robot.urdf.convex_hull import LARGEST_SIZE, SMALLEST_SIZE
from ff_planner_ros.robot.urdf.meshes import Meshes
from ff_planner_ros.robot.urdf.urdf_bodies import placement
from ff_planner_ros.robot.urdf.urdf_faults import Faults, listed


def _settle_boxes() -> None:
    """Ask Coal for the distance of a rotated box, before any other query.

    The first direction that Coal 3.0.3 looks along in a box decides whether boxes are larger by one
    in 1e10 as long as the process lives: a `static` in its `getShapeSupport` of boxes. So plans of
    one task differed from process to process, by a millionth of a millimetre.
    """
    round_, box = coal.Capsule(0.1, 0.1), coal.Box(1.0, 1.0, 1.0)
    turned = pin.rpy.rpyToMatrix(0.4, 0.5, 0.6)
    away = coal.Transform3s(turned, np.array([3.0, 4.0, 5.0]))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    coal.distance(round_, coal.Transform3s(), box, away, request, result)


_settle_boxes()

# The attributes of each kind's sizes in a URDF, a cone's as in SDFormat, and how many numbers each
# has [m].
SIZES = {
    "box": {"size": 3},
    "capsule": {"radius": 1, "length": 1},
    "cone": {"radius": 1, "length": 1},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
# A humanoid with both hands has a hundred; the pairs grow with the square.
MAX_BODIES = 300


@dataclass(frozen=True, eq=False)
class Body:
    """One convex solid, fixed to a link."""

    name: str  # of its link; `link#2` for a link's second solid
    link: str
    joint: int  # Pinocchio's, that carries it: 1 the chaser, 2 and more the arm's
    solid: coal.CollisionGeometry  # Sphere, Capsule, Box, Cylinder, Cone or Convex
    placement_in_joint: pin.SE3  # never changed
    center_in_joint: Array  # of a sphere around it; shape (3,) [m]
    radius: float  # of that sphere [m]
    # How the end of a centre line moves with the next joint, which slides; zero of all else. The
    # rest is as with this joint at zero, but for the radius. Shape (3,)
    slide_in_joint: Array = field(default_factory=zero_vector)

    FACTS = ("name", "link", "radius")
    __repr__ = in_a_line

    @property
    def stretches(self) -> bool:
        """Whether it is a centre line whose length follows the next joint."""
        return bool(self.slide_in_joint.any())


class Kind(enum.IntEnum):
    """Kind of a solid, which selects the formula of distances. The core has the same numbers."""

    ROUND = 0  # all points within a radius of a segment of the z axis: spheres and capsules
    BOX = 1
    CYLINDER = 2
    HULL = 3  # no formula: Coal measures distances
    CONE = 4  # likewise


def kind_and_sizes(solid: coal.CollisionGeometry) -> tuple[Kind, Sequence[float]]:
    """Return a solid's kind, and its half edges, or radius and half length, padded by zeros [m]."""
    if isinstance(solid, coal.Sphere):
        return Kind.ROUND, (solid.radius, 0.0, 0.0)
    if isinstance(solid, coal.Capsule):
        return Kind.ROUND, (solid.radius, solid.halfLength, 0.0)
    if isinstance(solid, coal.Box):
        return Kind.BOX, tuple(solid.halfSide)
    if isinstance(solid, coal.Cylinder):
        return Kind.CYLINDER, (solid.radius, solid.halfLength, 0.0)
    if isinstance(solid, coal.Cone):
        return Kind.CONE, (solid.radius, solid.halfLength, 0.0)
    return Kind.HULL, (0.0, 0.0, 0.0)


def bodies_of(robot: Element, model: pin.Model, meshes: Meshes, faults: Faults) -> tuple[Body, ...]:
    """Return the collision bodies of a robot; empty if there are too many.

    Args:
        robot: `<robot>` with the `<collision>` elements of its links; meshes in files are replaced
            in it by their convex hulls.
        faults: Collects what is wrong with the elements.
    """
    found: list[Body] = []
    if (count := len(robot.findall("link/collision"))) > MAX_BODIES:
        told, allowed = f"there {count} times", f"it may be at most {MAX_BODIES} times"
        faults.add("<collision>", "", "", told, allowed)
        return ()
    for link in robot.findall("link"):
        name = str(link.get("name"))
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        for number, collision in enumerate(link.findall("collision"), start=1):
            called = name if number == 1 else f"{name}#{number}"
            if not faults.vectors("link", name, "collision origin", collision.find("origin")):
                continue
            solid = collision_solid(name, collision, meshes, faults)
            if solid is not None:
                place = frame.placement * placement(collision.find("origin"))
                found.append(_body(called, name, frame.parentJoint, solid, place))
    return tuple(found)


def defining_numbers(body: Body) -> tuple[str, Array, Array]:
    """Return a body's kind, sizes or corners [m], and placement in its joint, shape (4, 4)."""
    solid = body.solid
    match solid:
        case coal.Box():
            sizes = 2.0 * solid.halfSide
        case coal.Sphere():
            sizes = np.array([solid.radius])
        case coal.Capsule() | coal.Cylinder() | coal.Cone():
            sizes = np.array([solid.radius, 2.0 * solid.halfLength])
        case _:
            sizes = solid.points()
    return type(solid).__name__.lower(), np.array(sizes), body.placement_in_joint.homogeneous


def _body(name: str, link: str, joint: int, solid: coal.CollisionGeometry, place: pin.SE3) -> Body:
    solid.computeLocalAABB()
    center = np.array(solid.aabb_center)
    return Body(
        name, link, joint, solid, place, frozen(place.act(center)), radius_around(solid, center)
    )


def radius_around(solid: coal.CollisionGeometry, center: Array) -> float:
    """Return the radius of a sphere about a solid's centre that holds the solid [m]."""
    if isinstance(solid, coal.Sphere):
        return float(solid.radius)
    if isinstance(solid, coal.Capsule):
        return float(solid.halfLength + solid.radius)
    if isinstance(solid, coal.Cylinder | coal.Cone):
        return math.hypot(solid.halfLength, solid.radius)
    if isinstance(solid, coal.Box):
        return float(np.linalg.norm(solid.halfSide))
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


def collision_solid(
    link: str, collision: Element, meshes: Meshes, faults: Faults
) -> coal.CollisionGeometry | None:
    """Return the solid of a `<collision>` of a link; None: it is faulty, and `faults` says how."""
    shape = collision.find("geometry/*")
    if shape is None:
        allowed = f"it must be one of {listed(SIZES)}, mesh"
        faults.add("link", link, "collision", "without a geometry that is known", allowed)
        return None
    if shape.tag == "mesh":
        return meshes.hull(link, collision, faults)
    sizes = [
        size
        for name, count in SIZES[shape.tag].items()
        for size in _numbers(link, f"collision {shape.tag} {name}", shape.get(name), count, faults)
    ]
    if not sizes or not all(sizes):
        return None
    match shape.tag:
        case "box":
            return coal.Box(*sizes)
        case "capsule":
            return coal.Capsule(*sizes)
        case "cone":
            return coal.Cone(*sizes)
        case "cylinder":
            return coal.Cylinder(*sizes)
        case _:
            return coal.Sphere(*sizes)


def _numbers(link: str, part: str, text: str | None, count: int, faults: Faults) -> list[float]:
    """Return sizes [m]; zeros: they are faulty."""
    try:
        sizes = [float(word) for word in (text or "").split()]
    except ValueError:
        sizes = []
    if len(sizes) == count and all(SMALLEST_SIZE <= size <= LARGEST_SIZE for size in sizes):
        return sizes
    numbers = "one number" if count == 1 else f"{count} numbers"
    allowed = f"it must be {numbers} from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} [m]"
    faults.add("link", link, part, repr(text) if text else "missing", allowed)
    return count * [0.0]
