"""Obstacles from ROS messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.common.declared_messages import names_in, value_at, values_in
from ff_planner_ros.errors import InvalidInput, Status, fields_named
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion, SphereEntry
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.collision.solids import (
    MAX_MESH_VERTICES,
    Solid,
    hull_of_vertices,
)

BODIES = "bodies"  # field of a scene and of a target body
_PRISM = 5
# A closed surface has twice as many triangles as vertices.
MAX_TRIANGLES = 2 * MAX_MESH_VERTICES


def obstacles_of(message: Any, source: str) -> tuple[Obstacle, ...]:
    """Return the spheres and bodies of a scene, at its stamp.

    Args:
        source: Topic or field of the message; prefix of the fields that errors name.

    Raises:
        InvalidInput: An obstacle is invalid, a sphere has an angular velocity, or two share an id.
    """
    _require_unique(message, source)
    return (
        *(_sphere(f"{source}.spheres[{i}]", one) for i, one in enumerate(message.spheres)),
        *(_body(f"{source}.{BODIES}[{i}]", one) for i, one in enumerate(message.bodies)),
    )


def attached_bodies_of(message: Any, source: str) -> tuple[AttachedObstacle, ...]:
    """Return the bodies in a target body's message, which are fixed to the target body.

    Raises:
        InvalidInput: A body is invalid or has a velocity of its own.
    """
    found = list[AttachedObstacle]()
    for index, one in enumerate(message.bodies):
        place = f"{source}.{BODIES}[{index}]"
        for part in ("twist.linear", "twist.angular"):
            require_zero(one, part, "what is fixed to a body moves with it", place)
        solid = solid_in(one, place)
        with fields_named(names_in(AttachedObstacle, f"target_body.obstacles[{one.id}]", place)):
            found.append(AttachedObstacle(shape=solid, **values_in(AttachedObstacle, one)))
    return tuple(found)


def solid_in(message: Any, field: str) -> Solid:
    """Return the shape of an `Obstacle` message: its primitive, or its mesh's convex hull.

    Args:
        field: Place of the obstacle; prefix of the fields that errors name.

    Raises:
        InvalidInput: There is not exactly one primitive or mesh, or the shape is invalid.
    """
    primitives, meshes = message.primitive, message.mesh
    if len(primitives) + len(meshes) != 1:
        found, allowed = "given twice" if len(primitives) else "missing", "give it or a mesh"
        raise InvalidInput(Status.WRONG_SIZE, f"{field}.primitive", found, allowed)
    if len(primitives):
        return _primitive(primitives[0], f"{field}.primitive")
    return _mesh(meshes[0], f"{field}.mesh")


def in_message(kind: str, sizes: Any) -> Any:
    """Return a primitive's sizes as `SolidPrimitive` orders them, or back: height before radius."""
    return sizes[::-1] if len(PRIMITIVES[kind].sizes) > 1 else sizes


def require_zero(message: Any, path: str, why: str, field: str) -> None:
    """Refuse a message whose vector at `path` is not zero.

    Raises:
        InvalidInput: The vector is not zero; `why` says why it must be, and the error names
            `field`.`path`.
    """
    numbers = _vector(value_at(message, path), f"{field}.{path}")
    if numbers.any():
        allowed = f"it must be zero: {why}"
        raise InvalidInput(Status.UNSUPPORTED, f"{field}.{path}", numbers.tolist(), allowed)


def _vector(message: Any, field: str) -> Array:
    return finite_vector(field, (message.x, message.y, message.z), 3)


def _require_unique(message: Any, source: str) -> None:
    first: dict[str, str] = {}
    for name, entries in (("spheres", message.spheres), (BODIES, message.bodies)):
        for index, one in enumerate(entries):
            place = f"{name}[{index}]"
            if first.setdefault(one.id, place) != place:
                raise InvalidInput(
                    Status.OUT_OF_RANGE,
                    f"{source}.{place}.id",
                    repr(one.id),
                    f"every id must be given once, and {first[one.id]} has it already",
                )


def _sphere(field: str, message: Any) -> Obstacle:
    turning = _vector(message.twist.angular, f"{field}.twist.angular")
    if turning.any():
        raise InvalidInput(
            Status.UNSUPPORTED,
            f"{field}.twist.angular",
            turning.tolist(),
            "it must be zero: nothing says what the sphere goes round; a body that turns, with all "
            "that is fixed to it, is a target_body",
        )
    with fields_named(names_in(SphereEntry, f"obstacles[{message.id}]", field)):
        sphere: Obstacle = SphereEntry(**values_in(SphereEntry, message)).made()
        return sphere


def _body(field: str, message: Any) -> Obstacle:
    solid = solid_in(message, field)
    names = names_in(Obstacle, f"obstacles[{message.id}]", field)
    with fields_named(names | names_in(RigidMotion, "motion", field)):
        return Obstacle(shape=solid, **values_in(Obstacle, message))


def _primitive(message: Any, field: str) -> Solid:
    kinds = {one.message: kind for kind, one in PRIMITIVES.items()}
    kind = kinds.get(message.type)
    if kind is None:
        named = ", ".join(f"{number} ({word.upper()})" for number, word in sorted(kinds.items()))
        found = "5 (PRISM)" if message.type == _PRISM else message.type
        allowed = f"it must be one of {named}; another one is a mesh"
        raise InvalidInput(Status.UNSUPPORTED, f"{field}.type", found, allowed)
    told, count = f"{field}.dimensions", PRIMITIVES[kind].count
    sizes = np.array(message.dimensions, np.float64)
    if len(sizes) != count:
        words = ", ".join("xyz" if count == 3 else in_message(kind, [*PRIMITIVES[kind].sizes]))
        allowed = f"a {kind} has {count}: {words}"
        raise InvalidInput(Status.WRONG_SIZE, told, sizes.tolist(), allowed)
    with fields_named({f"shape.{kind}": told}):
        return Solid(kind, in_message(kind, sizes))


def _mesh(message: Any, field: str) -> Solid:
    corners: Sequence[Any] = message.vertices
    # Before they are read: each is an object.
    _require_few(f"{field}.vertices", len(corners), MAX_MESH_VERTICES)
    _require_few(f"{field}.triangles", len(message.triangles), MAX_TRIANGLES)
    vertices = np.array([(p.x, p.y, p.z) for p in corners], np.float64).reshape(-1, 3)
    if not np.isfinite(vertices).all():
        worst = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        _vector(corners[worst], f"{field}.vertices[{worst}]")
    solid = hull_of_vertices(f"{field}.vertices", vertices)
    rows = np.array([one.vertex_indices for one in message.triangles], np.int64).reshape(-1, 3)
    if rows.max(initial=0) >= len(vertices):
        index = int(np.flatnonzero(rows.max(axis=1) >= len(vertices))[0])
        told, allowed = f"{field}.triangles[{index}]", f"there are {len(vertices)} vertices"
        raise InvalidInput(Status.OUT_OF_RANGE, told, rows[index].tolist(), allowed)
    return solid


def _require_few(field: str, count: int, most: int) -> None:
    if count > most:
        allowed = f"it may have {most} at most"
        raise InvalidInput(Status.OUT_OF_RANGE, field, f"{count} entries", allowed)
