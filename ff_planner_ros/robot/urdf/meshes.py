"""Meshes as convex solids: from files, or embedded in a recorded URDF."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.share import PACKAGE_SCHEME, package_directory
from ff_planner_ros.common.text_file import not_a_file
from ff_planner_ros.robot.urdf.convex_hull import LARGEST_SIZE, NoSolid, convex_solid, once, said_of
from ff_planner_ros.robot.urdf.mesh_files import MAX_FILE, MAX_FILES, obj_vertices, stl_vertices
from ff_planner_ros.robot.urdf.mesh_scenes import collada_vertices, gltf_vertices
from ff_planner_ros.robot.urdf.urdf_faults import Faults, shortened

_SUFFIXES = (".stl", ".obj", ".dae", ".glb", ".gltf")
# How a recorded URDF carries a hull: x, y, z of each vertex, before `scale`, little-endian.
EMBEDDED = "data:application/x-float32-points;base64,"
_FILE_SCHEME = "file://"
_LINES_NEED_NONE = "with robot.geometry lines no mesh is read"


class Meshes:
    """Reads the meshes of one robot, each file once."""

    def __init__(self, directory: Path | None) -> None:
        """Take the directory of the URDF; None: it is from elsewhere, and no file is read."""
        self.notes: list[str] = []  # on simplified hulls, units and axes
        self._directory = directory
        self._vertices: dict[Path, Array] = {}  # by file [m]
        self._bytes = 0  # of the files that were read

    def hull(self, link: str, collision: Element, faults: Faults) -> coal.Convex | None:
        """Return the convex hull of a `<mesh>`, and embed it in the element; None: it is faulty."""
        mesh = collision.find("geometry/mesh")
        if mesh is None:
            raise ValueError("the collision has another geometry")
        name = mesh.get("filename", "")
        try:
            scale = _scale(mesh.get("scale"))
            points, hull = self.convex(name, scale)
        except NoSolid as fault:
            value = "embedded" if name.startswith("data:") else name or "without a filename"
            faults.add("link", link, "collision mesh", value, str(fault), mesh)
            return None
        mesh.set("filename", EMBEDDED + base64.b64encode(points.astype("<f4").tobytes()).decode())
        mesh.set("scale", " ".join(repr(float(number)) for number in scale))
        return hull

    def convex(self, name: str, scale: Array) -> tuple[Array, coal.Convex]:
        """Return a hull's corners before scaling, and the scaled hull.

        Args:
            name: Path of the mesh's file, or the embedded corners of a recorded URDF.
            scale: Factor along each axis; shape (3,).

        Raises:
            ValueError: A `NoSolid`: the mesh has no hull, or cannot be read within the limits.
        """
        try:
            given = _decoded(name) if name.startswith(EMBEDDED) else self._of_file(name)
            points, hull, growth = convex_solid(given, scale)
        except NoSolid:
            raise
        except (RuntimeError, ValueError, OSError):  # of Coal, or of a path that no file can have
            raise NoSolid("it cannot be read") from None
        except MemoryError:
            raise NoSolid("there is too little memory to read it") from None
        file = "embedded" if name.startswith("data:") else shortened(Path(name).name)
        for note in said_of(len(given), len(points), growth):
            self.notes.append(f"mesh {file}: {note}")
        return points, hull

    def _of_file(self, name: str) -> Array:
        """Return the vertices of the mesh in a file, before `scale`."""
        path = _path(name, self._directory)
        if path not in self._vertices:
            self._vertices[path], notes = vertices_of(path, self._content)
            self.notes += [f"mesh {shortened(path.name)}: {note}" for note in notes]
        return self._vertices[path]

    def _content(self, path: Path) -> bytes:
        self._bytes += _size(path)
        if self._bytes > MAX_FILES:
            raise NoSolid(f"all files together have more than {MAX_FILES} bytes")
        with path.open("rb") as file:
            return file.read(MAX_FILE)


def vertices_of(path: Path, read: Callable[[Path], bytes]) -> tuple[Array, list[str]]:
    """Return the vertices of a file in the axes of its link [m], and notes on units and axes.

    Vertices are rounded to single precision, as in a recorded URDF.

    Args:
        path: Its suffix says the format.
        read: Returns the content of a file, which may be one that this one needs.

    Raises:
        ValueError: A `NoSolid`: the file holds no mesh, or cannot be read within the limits.
    """
    notes, kind, data = list[str](), path.suffix.lower(), read(path)
    try:
        with np.errstate(all="ignore"):  # numbers too large are refused as vertices too far away
            if kind == ".stl":
                points = stl_vertices(data)
            elif kind == ".obj":
                points = obj_vertices(data)
            elif kind == ".dae":
                points = collada_vertices(data, notes)
            else:
                points = gltf_vertices(data, lambda name: read(_beside(path, name)))
            points = once(points.astype(np.float32).astype(float))
    except NoSolid:
        raise
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        raise NoSolid("it cannot be read: it is damaged, or no such file") from None
    if not len(points):
        raise NoSolid("it cannot be read: there is no mesh in it")
    return points, notes


def _beside(path: Path, name: str) -> Path:
    """Return the path of a file in a file's directory, or below."""
    found = (path.parent / name).resolve()
    if ":" in name or not found.is_relative_to(path.parent.resolve()):
        raise NoSolid("it names a file that is not beside it")
    return found


def _scale(text: str | None) -> Array:
    try:
        scale = np.array((text or "1 1 1").split(), float)
    except ValueError:
        scale = np.zeros(0)
    size = np.abs(scale)
    if scale.shape != (3,) or not ((size > 0.0) & (size <= LARGEST_SIZE)).all():
        allowed = f"it must be three numbers, none 0 or larger than {LARGEST_SIZE:g}"
        raise NoSolid(f"its scale is {shortened(text or '')!r}: {allowed}")
    return scale


def _decoded(uri: str) -> Array:
    try:
        numbers = base64.b64decode(uri.removeprefix(EMBEDDED), validate=True)
        return np.frombuffer(numbers, "<f4").reshape(-1, 3).astype(float)
    except (binascii.Error, ValueError):
        raise NoSolid("it is damaged") from None


def _path(name: str, directory: Path | None) -> Path:
    """Return the path of a file that a URDF in a directory names."""
    if directory is None:
        raise NoSolid(
            "this URDF is not from a file, and may name no others; the planner's own records "
            f"carry their meshes; {_LINES_NEED_NONE}"
        )
    if not name.lower().endswith(_SUFFIXES):
        raise NoSolid(f"it must be a file that ends in {', '.join(_SUFFIXES)}")
    if name.startswith(PACKAGE_SCHEME):
        package, _, inside = name.removeprefix(PACKAGE_SCHEME).partition("/")
        above = [
            parent / package
            for parent in (directory, *directory.parents)
            if package.strip(".")  # neither empty nor a parent directory
        ]
        for share in filter(None, (package_directory(package), *above)):
            if (share / inside).is_file():
                return (share / inside).resolve()
        raise NoSolid(f"no package {package!r} with this file is found; {_LINES_NEED_NONE}")
    if name.startswith(_FILE_SCHEME):
        name = unquote(name.removeprefix(_FILE_SCHEME).removeprefix("localhost"))
    elif "://" in name:
        raise NoSolid(f"it must be a path, {_FILE_SCHEME} or {PACKAGE_SCHEME}")
    return (directory / name).resolve()


def _size(path: Path) -> int:
    """Return the size of a file that can be read whole [bytes]."""
    try:
        reason, size = not_a_file(path), path.stat().st_size
    except (OSError, ValueError):
        reason, size = f"there is no such file; {_LINES_NEED_NONE}", 0
    if reason:
        raise NoSolid(reason)
    if size > MAX_FILE:
        raise NoSolid(
            f"it has {size} bytes, more than {MAX_FILE}: a million triangles; "
            "`collision` needs a simpler one"
        )
    return size
