"""The collision bodies of a robot, from the `<collision>` elements of its URDF."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen, zero_vector
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.robot.collision.primitives import PRIMITIVES, primitive_of, radius_around
from ff_planner_ros.robot.urdf.convex_hull import LARGEST_SIZE, SMALLEST_SIZE
from ff_planner_ros.robot.urdf.meshes import Meshes
from ff_planner_ros.robot.urdf.urdf_bodies import placement
from ff_planner_ros.robot.urdf.urdf_faults import Faults, finite_numbers, listed, shortened


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


def drop_points(robot: Element, faults: Faults) -> None:
    """Drop solids without any extent, which simulators have at frames and contacts; note them.

    Args:
        robot: As of `bodies_of`.
        faults: Collects the notes.
    """
    for link in robot.findall("link"):
        for collision in link.findall("collision"):
            shape = collision.find("geometry/*")
            if shape is None or shape.tag not in PRIMITIVES:
                continue
            texts = (shape.get(name, "") for name in PRIMITIVES[shape.tag].sizes)
            sizes = [size for text in texts for size in finite_numbers(text)]
            if sizes and not any(sizes):
                link.remove(collision)
                told = f"<{shape.tag}> of link {shortened(str(link.get('name')))}, without extent"
                faults.unread[told] = None


def bodies_of(robot: Element, model: pin.Model, meshes: Meshes, faults: Faults) -> tuple[Body, ...]:
    """Return the collision bodies of a robot; empty if there are too many.

    Args:
        robot: `<robot>` with the `<collision>` elements of its links; meshes in files are replaced
            in it by their convex hulls.
        faults: Collects what is wrong with the elements.
    """
    found: list[Body] = []
    for name, link, solid, place in solids_of(robot, meshes, faults):
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        found.append(_body(name, link, frame.parentJoint, solid, frame.placement * place))
    return tuple(found)


def solids_of(
    robot: Element, meshes: Meshes, faults: Faults
) -> Iterator[tuple[str, str, coal.CollisionGeometry, pin.SE3]]:
    """Yield each sound solid: its name, its link, and its placement in the link.

    Args:
        robot: As of `bodies_of`. One with too many solids has none, and is a fault.
        faults: Collects what is wrong with the elements.
    """
    if (count := len(robot.findall("link/collision"))) > MAX_BODIES:
        told, allowed = f"there {count} times", f"it may be at most {MAX_BODIES} times"
        faults.add("<collision>", "", "", told, allowed)
        return
    for link in robot.findall("link"):
        name = str(link.get("name"))
        for number, collision in enumerate(link.findall("collision"), start=1):
            origin = collision.find("origin")
            if not faults.vectors("link", name, "collision origin", origin):
                continue
            solid = _solid(name, collision, meshes, faults)
            if solid is not None:
                called = name if number == 1 else f"{name}#{number}"
                yield called, name, solid, placement(origin)


def defining_numbers(body: Body) -> tuple[str, Array, Array]:
    """Return a body's kind, sizes or corners [m], and placement in its joint, shape (4, 4)."""
    name, numbers = primitive_of(body.solid) or ("convex", np.array(body.solid.points()))
    return name, numbers, body.placement_in_joint.homogeneous


def _body(name: str, link: str, joint: int, solid: coal.CollisionGeometry, place: pin.SE3) -> Body:
    solid.computeLocalAABB()
    center = np.array(solid.aabb_center)
    return Body(
        name, link, joint, solid, place, frozen(place.act(center)), radius_around(solid, center)
    )


def _solid(
    link: str, collision: Element, meshes: Meshes, faults: Faults
) -> coal.CollisionGeometry | None:
    """Return the solid of a `<collision>` of a link; None: it is faulty, and `faults` says how."""
    shape = collision.find("geometry/*")
    if shape is None:
        allowed = f"it must be one of {listed(sorted(PRIMITIVES))}, mesh"
        faults.add(
            "link", link, "collision", "without a geometry that is known", allowed, collision
        )
        return None
    if shape.tag == "mesh":
        return meshes.hull(link, collision, faults)
    primitive, told = PRIMITIVES[shape.tag], f"collision {shape.tag}"
    sizes = [
        size
        for name, count in primitive.sizes.items()
        for size in _numbers(link, f"{told} {name}", shape, name, count, faults)
    ]
    return primitive.made(*sizes) if sizes and all(sizes) else None


def _numbers(
    link: str, part: str, shape: Element, name: str, count: int, faults: Faults
) -> list[float]:
    """Return sizes [m]; zeros: they are faulty."""
    text = shape.get(name)
    try:
        sizes = [float(word) for word in (text or "").split()]
    except ValueError:
        sizes = []
    if len(sizes) == count and all(SMALLEST_SIZE <= size <= LARGEST_SIZE for size in sizes):
        return sizes
    numbers = "one number" if count == 1 else f"{count} numbers"
    allowed = f"it must be {numbers} from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} [m]"
    faults.add("link", link, part, repr(text) if text else "missing", allowed, shape)
    return count * [0.0]
