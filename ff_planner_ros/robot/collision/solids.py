"""Convex solids as scenarios name them: boxes, cylinders, capsules, cones, and hulls of meshes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self, TypeVar

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array, finite_rows, finite_vector, frozen
from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import NAME, ROWS, Form, Schema, a_number, of_mapping, of_numbers
from ff_planner_ros.common.plain_values import (
    an_object,
    any_text,
    dotted,
    mapping,
    number,
    numbers,
    of_checked,
    text,
)
from ff_planner_ros.common.shown import in_a_line, quoted
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.primitives import (
    PRIMITIVES,
    furthest,
    primitive_of,
    radius_around,
)
from ff_planner_ros.robot.urdf.convex_hull import (
    LARGEST_SIZE,
    SMALLEST_SIZE,
    NoSolid,
    convex_solid,
    said_of,
)
from ff_planner_ros.robot.urdf.meshes import Meshes

SPHERE, MESH = "sphere", "mesh"
KINDS = (*PRIMITIVES, MESH)
# Of a mesh in a file or message, whose hull is computed in the calling process.
MAX_MESH_VERTICES = 100_000
_GROWN = a_number(at_least=0.0)
_NO_CORNERS = frozen(np.zeros((0, 3)))
RADIUS = a_number(above=0.0)  # of a sphere [m]


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex solid in its own frame.

    Raises:
        InvalidInput: The kind is unknown, a size is missing, surplus or out of range.
    """

    kind: str  # of `KINDS`
    sizes: Array = field(default_factory=lambda: np.zeros(0))  # in the order of `PRIMITIVES` [m]
    corners: Array = field(default_factory=lambda: np.zeros((0, 3)))  # of a mesh's hull [m]
    # Inflation in all directions, with rounded corners, that of a sphere added to its radius; in no
    # file and no message [m]
    grown: float = 0.0
    notes: tuple[str, ...] = ()  # for the user, on a mesh; in no message

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        if any_text("shape", self.kind) not in KINDS:
            raise InvalidInput(Status.UNSUPPORTED, "shape", quoted(self.kind), _one_of_kinds())
        count = 0 if self.kind == MESH else PRIMITIVES[self.kind].count
        sizes = finite_vector(f"shape.{self.kind}", self.sizes, count)
        told = f"shape.{self.kind}"
        if self.kind == SPHERE:  # with which nothing goes wrong, however large or small
            RADIUS.checked(told, float(sizes[0]))
        elif count and not SMALLEST_SIZE <= sizes.min() <= sizes.max() <= LARGEST_SIZE:
            allowed = f"it must be from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m"
            raise InvalidInput(Status.OUT_OF_RANGE, told, sizes.tolist(), allowed)
        _GROWN.checked("shape.grown", self.grown)
        an_object("shape.notes", self.notes, tuple)
        corners = finite_rows("shape.mesh", self.corners, 3)
        if self.kind == SPHERE and self.grown:
            sizes = frozen(sizes + self.grown)
            object.__setattr__(self, "grown", 0.0)
        object.__setattr__(self, "sizes", sizes)
        object.__setattr__(self, "corners", corners)

    @classmethod
    def of_radius(cls, radius: float) -> Solid:
        """Return a sphere of a radius [m] that has been checked."""
        return of_checked(
            cls, kind=SPHERE, sizes=frozen([radius]), corners=_NO_CORNERS, grown=0.0, notes=()
        )

    @property
    def words(self) -> str:
        """Kind and sizes [m], or number of corners, as text."""
        if self.kind == MESH:
            return f"mesh of {len(self.corners)} corners"
        return f"{self.kind} {' x '.join(format(size, 'g') for size in self.sizes.tolist())}"

    @cached_property
    def geometry(self) -> coal.CollisionGeometry:
        """The solid as a Coal geometry, inflated by `grown`."""
        if self.kind == MESH:
            geometry = convex_solid(self.corners, np.ones(3))[1]
        else:
            geometry = PRIMITIVES[self.kind].made(*self.sizes)
        geometry.computeLocalAABB()  # whose centre is that of the sphere around it, too
        geometry.setSweptSphereRadius(self.grown)
        return geometry

    @cached_property
    def center(self) -> Array:
        """Centre of a bounding sphere. Shape (3,) [m]."""
        return frozen(self.geometry.aabb_center)

    @cached_property
    def radius(self) -> float:
        """Radius of the bounding sphere about `center` [m]."""
        return radius_around(self.geometry, self.center) + self.grown

    @cached_property
    def reach(self) -> float:
        """Upper bound of the distance of its points from the origin of its frame [m]."""
        return float(np.linalg.norm(self.center)) + self.radius

    def furthest(self, ways: Array) -> Array:
        """Return the support function: the largest coordinate along each direction [m]. (ways,).

        Args:
            ways: Directions in its frame, of unit length. Shape (ways, 3).
        """
        return furthest(self.geometry, ways)


@dataclass(frozen=True)
class MeshFile:
    """A mesh in a file whose path is relative to a scenario's, or `package://`."""

    kind: ClassVar[str] = MESH
    file: str
    scale: tuple[float, ...]

    def load(self, told: str, meshes: Meshes) -> Solid:
        """Read the mesh and return its convex hull.

        Args:
            told: Field of the mesh in errors.
            meshes: Reads it, from the directory that its path is relative to.

        Raises:
            InvalidInput: The file cannot be read within the limits of a robot's meshes, or the mesh
                has no hull.
        """
        scale, known = np.array(self.scale), len(meshes.notes)
        try:
            corners, _ = meshes.convex(self.file, scale)
        except NoSolid as fault:
            allowed = str(fault)
            raise InvalidInput(Status.OUT_OF_RANGE, f"{told}.file", self.file, allowed) from None
        # The same order of corners as after writing and reading them.
        solid = hull_of_vertices(f"{told}.file", corners * scale)
        return replace(solid, notes=tuple(meshes.notes[known:]))


def hull_of_vertices(told: str, vertices: Array) -> Solid:
    """Return the convex hull of vertices as a solid.

    Args:
        told: Field of the vertices in errors.
        vertices: Shape (vertices, 3) [m].

    Raises:
        InvalidInput: There are too many vertices, or they have no hull: they lie in a plane, say.
    """
    many = f"{len(vertices)} vertices"
    if len(vertices) > MAX_MESH_VERTICES:
        allowed = f"it may have {MAX_MESH_VERTICES} at most"
        raise InvalidInput(Status.OUT_OF_RANGE, told, many, allowed)
    try:
        corners, _, growth = convex_solid(vertices, np.ones(3))
    except (RuntimeError, ValueError) as fault:
        why = str(fault) if isinstance(fault, NoSolid) else "it has no convex hull"
        raise InvalidInput(Status.OUT_OF_RANGE, told, many, why) from None
    notes = said_of(len(vertices), len(corners), growth)
    return Solid(MESH, corners=corners, notes=tuple(f"{told}: {note}" for note in notes))


def solid_of(geometry: coal.CollisionGeometry) -> Solid:
    """Return the solid of a Coal geometry."""
    primitive = primitive_of(geometry)
    if primitive is None:
        return hull_of_vertices(MESH, np.array(geometry.points()))
    return Solid(*primitive)


def _read(told: str, value: object) -> Solid | MeshFile:
    """Return the solid of a mapping with one kind: `{box: {size: [..]}}`."""
    if not isinstance(value, dict) or len(value) != 1 or next(iter(value)) not in KINDS:
        raise InvalidInput(Status.UNSUPPORTED, told, quoted(value), _one_of_kinds())
    ((kind, given),) = value.items()
    here = dotted(told, kind)
    if kind == MESH:
        return _mesh(here, given)
    sizes, entry = list[float](), mapping(here, given, PRIMITIVES[kind].sizes)
    for word, count in PRIMITIVES[kind].sizes.items():
        place = dotted(here, word)
        read = numbers(place, entry[word]) if count > 1 else [number(place, entry[word])]
        for size in finite_vector(place, read, count):
            if not SMALLEST_SIZE <= size <= LARGEST_SIZE:
                allowed = f"it must be from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m"
                raise InvalidInput(Status.OUT_OF_RANGE, place, float(size), allowed)
            sizes.append(float(size))
    return Solid(kind, np.array(sizes))


def _mesh(told: str, value: object) -> Solid | MeshFile:
    """Return the mesh of a file, or the hull of vertices."""
    if isinstance(value, dict) and "vertices" in value:
        entry = mapping(told, value, ("vertices",))
        rows = ROWS.read(dotted(told, "vertices"), entry["vertices"])
        points = [finite_vector(f"{told}.vertices[{k}]", row, 3) for k, row in enumerate(rows)]
        return hull_of_vertices(dotted(told, "vertices"), np.array(points).reshape(-1, 3))
    entry, scale = mapping(told, value, ("file",), ("scale",)), np.ones(3)
    if "scale" in entry:
        place = dotted(told, "scale")
        scale = finite_vector(place, numbers(place, entry["scale"]), 3)
        if not (scale.all() and np.abs(scale).max() <= LARGEST_SIZE):
            allowed = f"no entry may be 0 or larger than {LARGEST_SIZE:g}"
            raise InvalidInput(Status.OUT_OF_RANGE, place, scale.tolist(), allowed)
    return MeshFile(text(dotted(told, "file"), entry["file"]), tuple(scale.tolist()))


def _written(given: Solid | MeshFile) -> dict[str, Any]:
    if isinstance(given, MeshFile):
        return {MESH: {"file": given.file, "scale": list(given.scale)}}
    if given.kind == MESH:
        return {MESH: {"vertices": given.corners.tolist()}}
    said = by_name(given)
    return {
        given.kind: {
            word: sizes if PRIMITIVES[given.kind].sizes[word] > 1 else sizes[0]
            for word, sizes in said.items()
        }
    }


def by_name(solid: Solid) -> dict[str, list[float]]:
    """Return the numbers of each of a primitive's sizes [m]."""
    sizes, found = solid.sizes.tolist(), dict[str, list[float]]()
    for word, count in PRIMITIVES[solid.kind].sizes.items():
        found[word], sizes = sizes[:count], sizes[count:]
    return found


def _schema() -> Schema:
    size: Schema = {"type": "number", "minimum": SMALLEST_SIZE, "maximum": LARGEST_SIZE}
    choices = [
        of_mapping(
            {
                kind: of_mapping(
                    {
                        word: size if count == 1 else of_numbers(count) | {"items": size}
                        for word, count in primitive.sizes.items()
                    }
                )
            }
        )
        for kind, primitive in PRIMITIVES.items()
    ]
    file = of_mapping({"file": {"type": "string", "minLength": 1}, "scale": of_numbers(3)})
    rows: Schema = {"type": "array", "items": of_numbers(3)}
    vertices = of_mapping({"vertices": rows})
    file["required"], vertices["required"] = ["file"], ["vertices"]
    meshes = of_mapping({MESH: {"anyOf": [file, vertices]}})
    return {"oneOf": [*choices, meshes]}


def _checked(told: str, given: object) -> Solid | MeshFile:
    return given if isinstance(given, MeshFile) else an_object(told, given, Solid)


def _one_of_kinds() -> str:
    return f"it must be one of {', '.join(KINDS)}, with its sizes: {{box: {{size: [1, 2, 3]}}}}"


SHAPE = Form(_read, _schema, _checked, _written)
SHAPE_SENTENCE = (
    "cylinder, capsule and cone lie along z about their middle, a cone's apex at +z; a capsule's "
    "length is without its caps; a mesh counts by its convex hull"
)


@dataclass(frozen=True, eq=False)
class Shaped:
    """What has a name and a convex shape."""

    PLACE: ClassVar[str] = ""  # the list that it stands in, in errors

    id: str = declare(NAME, "name in messages and errors, unique", message="id")
    shape: Solid | MeshFile = declare(SHAPE, SHAPE_SENTENCE, unit="m")

    @property
    def solid(self) -> Solid:
        """Its shape.

        Raises:
            InvalidInput: The shape is a mesh file that has not been read.
        """
        if isinstance(self.shape, MeshFile):
            told, allowed = f"{self.PLACE}[{self.id}].shape", "its file must be read before"
            raise InvalidInput(Status.UNSUPPORTED, told, self.shape.file, allowed)
        return self.shape

    def with_mesh_read(self, told: str, meshes: Meshes) -> Self:
        """Return it with its mesh file read, if it has one.

        Args:
            told: Name of its field in errors.
            meshes: Reads mesh files.

        Raises:
            InvalidInput: The file cannot be read, or its mesh has no convex hull.
        """
        if isinstance(self.shape, Solid):
            return self
        return replace(self, shape=self.shape.load(f"{told}.shape.{MESH}", meshes))

    @property
    def is_sphere(self) -> bool:
        """Whether it is a sphere, to which its attitude does not matter."""
        return self.shape.kind == SPHERE

    @property
    def radius(self) -> float:
        """Radius of the sphere that it is, or of one around it [m]."""
        return self.solid.radius


Thing = TypeVar("Thing", bound=Shaped)


def in_order(things: Iterable[Thing]) -> tuple[Thing, ...]:
    """Return things as messages have them, in an array of spheres and one of others."""
    return tuple(sorted(things, key=lambda one: not one.is_sphere))
