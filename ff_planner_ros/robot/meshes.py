"""Meshes as convex solids: from files, or as a recorded URDF carries them itself."""

from __future__ import annotations

import base64
import binascii
import stat
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import coal
import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.robot.urdf_faults import Faults, shortened
from ff_planner_ros.share import PACKAGE_SCHEME, package_directory

# A solid that is smaller is a slip of the pen, and one that is larger no robot [m].
SMALLEST_SIZE, LARGEST_SIZE = 1e-6, 1e4
# Of its length: what is thinner is flat but for rounding, and has no convex hull.
_THINNEST = 1e-6
# Those of robots have a few hundred; each point costs time at every distance.
MAX_VERTICES = 1000
# Directions in which a hull of more is kept as large as it is: twice as many vertices at most.
_DIRECTIONS = 300
# Of more points, first those are left out that lie well inside; if they are still more, their hull
# is not even tried: it takes a second, and more than a second for more.
_MANY = 10_000
# A binary STL of a million triangles: it is read in two seconds. And all files of a robot [bytes].
MAX_FILE, MAX_FILES = 50_000_100, 200_000_000
_SUFFIXES = (".stl", ".obj", ".dae")
# How a recorded URDF carries a hull: x, y, z of each vertex, before `scale`, little-endian.
_EMBEDDED = "data:application/x-float32-points;base64,"
_FILE_SCHEME = "file://"
_LINES_NEED_NONE = "with robot.geometry lines no mesh is read"


class Meshes:
    """Reads the meshes of one robot, each file once."""

    def __init__(self, directory: Path | None) -> None:
        """Take the directory of the URDF; None: it is from elsewhere, and no file is read."""
        self.notes: list[str] = []  # on what was simplified
        self._directory = directory
        self._of_files: dict[Path, Array] = {}
        self._bytes = 0  # read so far

    def hull(self, link: str, mesh: Element, faults: Faults) -> coal.Convex | None:
        """Return the convex hull of a `<mesh>`, and write it into the element; None: a fault."""
        name = mesh.get("filename", "")
        try:
            scale = _scale(mesh.get("scale"))
            given = _decoded(name) if name.startswith(_EMBEDDED) else self._points(name)
            points = self._few(given, name)
            hull = _hull(_solid_points(points * scale))
        except _NoMesh as fault:
            value = "embedded" if name.startswith("data:") else name or "without a filename"
            faults.add("link", link, "collision mesh", value, str(fault))
            return None
        mesh.set("filename", _EMBEDDED + base64.b64encode(points.astype("<f4").tobytes()).decode())
        mesh.set("scale", " ".join(repr(float(number)) for number in scale))
        return hull

    def _points(self, name: str) -> Array:
        """Return the vertices of a file, before `scale`."""
        path = _path(name, self._directory)
        if path not in self._of_files:
            self._bytes += _size(path)
            if self._bytes > MAX_FILES:
                raise _NoMesh(f"all files together have more than {MAX_FILES} bytes")
            self._of_files[path] = _vertices(path)
        return self._of_files[path]

    def _few(self, points: Array, name: str) -> Array:
        """Return the corners of a convex solid that holds all points, in an order of their own."""
        for _ in range(2):
            points = _solid_points(points)
            corners = _corners(points)
            if corners is not None and len(corners) <= MAX_VERTICES:
                return corners
            simple = _around(points)
            file = "embedded" if name.startswith("data:") else shortened(Path(name).name)
            self.notes.append(
                f"mesh {file}: its hull is simplified, at most {_growth(points, simple):.2g} of "
                f"its size larger, from the vertices of {len(points)} to {len(_once(simple))}"
            )
            points = simple
        raise _NoMesh("its convex hull cannot be simplified")


class _NoMesh(Exception):
    """Why a mesh cannot be taken."""


def _scale(text: str | None) -> Array:
    try:
        scale = np.array((text or "1 1 1").split(), float)
    except ValueError:
        scale = np.zeros(0)
    if scale.shape != (3,) or not np.isfinite(scale).all() or not scale.all():
        raise _NoMesh(f"its scale is {shortened(text or '')!r}: it must be three numbers, none 0")
    return scale


def _decoded(uri: str) -> Array:
    try:
        numbers = base64.b64decode(uri.removeprefix(_EMBEDDED), validate=True)
        return np.frombuffer(numbers, "<f4").reshape(-1, 3).astype(float)
    except (binascii.Error, ValueError):
        raise _NoMesh("it is damaged") from None


def _path(name: str, directory: Path | None) -> Path:
    """Return where a file is that a URDF in a directory names."""
    if directory is None:
        raise _NoMesh(
            "this URDF is not from a file, and may name no others; the planner's own records "
            f"carry their meshes; {_LINES_NEED_NONE}"
        )
    if not name.lower().endswith(_SUFFIXES):
        raise _NoMesh(f"it must be a file that ends in {', '.join(_SUFFIXES)}")
    if name.startswith(PACKAGE_SCHEME):
        package, _, inside = name.removeprefix(PACKAGE_SCHEME).partition("/")
        above = [parent for parent in (directory, *directory.parents) if parent.name == package]
        for share in filter(None, (package_directory(package), *above)):
            if (share / inside).is_file():
                return (share / inside).resolve()
        raise _NoMesh(f"no package {package!r} with this file is found; {_LINES_NEED_NONE}")
    if name.startswith(_FILE_SCHEME):
        name = unquote(name.removeprefix(_FILE_SCHEME))
    elif "://" in name:
        raise _NoMesh(f"it must be a path, {_FILE_SCHEME} or {PACKAGE_SCHEME}")
    return (directory / name).resolve()


def _size(path: Path) -> int:
    """Return the size of a file that can be read whole [bytes]."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        raise _NoMesh(f"there is no such file; {_LINES_NEED_NONE}") from None
    if not stat.S_ISREG(status.st_mode):
        raise _NoMesh("it is no regular file")
    if status.st_size > MAX_FILE:
        raise _NoMesh(
            f"it has {status.st_size} bytes, more than {MAX_FILE}: a million triangles; "
            "`collision` needs a simpler one"
        )
    return status.st_size


def _vertices(path: Path) -> Array:
    try:
        found = coal.MeshLoader(coal.BV_AABB).load(str(path), np.ones(3))
        return np.array(found.vertices(), float).astype(np.float32).astype(float)
    except Exception as error:  # whatever Coal and Assimp throw
        raise _NoMesh(f"it cannot be read: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    """Return what Coal says, without where in its code it says so."""
    words = str(error).partition("message: ")[2].split("\n")[0].strip()
    return "there is no mesh in it" if not words or words.startswith("Could not load") else words


def _solid_points(points: Array) -> Array:
    """Return points in an order of their own, each once; what has no volume has no hull."""
    if not len(points) or not np.isfinite(points).all() or np.abs(points).max() > LARGEST_SIZE:
        raise _NoMesh(f"it must have vertices, none further than {LARGEST_SIZE:g} m")
    points = _once(points)
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    extents = np.ptp(centred @ axes, axis=0)
    if extents.min() < max(SMALLEST_SIZE, _THINNEST * extents.max()):
        raise _NoMesh("it is flat, and has no volume: a thin <box> says how thick it is")
    return points


def _once(points: Array) -> Array:
    """Return the rows in order, each once."""
    points = points[np.lexsort(points.T)] + 0.0  # no negative zeros
    first: Array = points[np.append(True, (points[1:] != points[:-1]).any(axis=1))]
    return first


def _corners(points: Array) -> Array | None:
    """Return the corners of the hull, such that theirs are all of them; None: too many for Coal."""
    if len(points) > _MANY:
        points = _outer(points)
    while len(points) <= _MANY:
        try:
            found = _once(_hull(points).points())
        except RuntimeError:  # an edge fan of more than 255 at one corner
            return None
        if len(found) == len(points):
            return points
        points = found
    return None


def _outer(points: Array) -> Array:
    """Return points without those inside the hull of the outermost ones in some directions."""
    inner = _hull(_solid_points(_outermost(points)))
    outside = np.zeros(len(points), bool)
    for normal, offset in zip(inner.normals(), inner.offsets(), strict=True):
        outside |= points @ normal + offset > -_THINNEST
    return points[outside]


def _outermost(points: Array) -> Array:
    """Return the point that is furthest, for each of some directions."""
    # One after the other: all at once would need gigabytes.
    return np.array([points[np.argmax(points @ way)] for way in _ways(_DIRECTIONS)])


def _hull(points: Array) -> coal.Convex:
    rows = coal.StdVec_Vec3s()
    rows.extend(list(points))
    return coal.Convex.convexHull(rows, True, "Qt")


def _around(points: Array) -> Array:
    """Return the corners of the solid between planes that touch the points from outside.

    Planes n.(x - c) = h about an inner point c have the solid's corners as the planes of the hull
    of the points n / h: each is the dual of the other.
    """
    ways = _ways(_DIRECTIONS)
    center = _outermost(points).mean(axis=0)
    reach = np.array([((points - center) @ way).max() for way in ways])
    dual = _hull(ways / reach[:, None])
    corners = dual.points()
    faces = [dual.polygons(i) for i in range(dual.num_polygons)]
    planes = np.array([[corners[face[k]] for k in range(3)] for face in faces])
    normal = np.cross(planes[:, 1] - planes[:, 0], planes[:, 2] - planes[:, 0])
    height = np.einsum("ij,ij->i", normal, planes[:, 0])
    outside = normal / height[:, None] * (1.0 + _THINNEST)  # more than float32 rounds
    corners = np.array(center + outside, np.float32)
    return corners.astype(float)


def _ways(count: int) -> Array:
    """Return directions all around, the axes among them; shape (count + 6, 3)."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - height**2)
    spiral = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    return np.vstack([spiral, np.eye(3), -np.eye(3)])


def _growth(points: Array, simple: Array) -> float:
    """Return how much further a solid reaches than the points, of their size, in many ways."""
    ways = _ways(_DIRECTIONS // 2)
    further = np.array([(simple @ way).max() - (points @ way).max() for way in ways])
    return float(further.max() / np.ptp(points, axis=0).max())
