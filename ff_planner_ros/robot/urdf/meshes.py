"""Meshes as convex solids: from files, or as a recorded URDF carries them itself."""

from __future__ import annotations

import base64
import binascii
import math
import re
import stat
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.share import PACKAGE_SCHEME, package_directory
from ff_planner_ros.robot.urdf.convex_hull import LARGEST_SIZE, NoSolid, convex_solid
from ff_planner_ros.robot.urdf.urdf_faults import Faults, shortened

# A binary STL of a million triangles: it is read in two seconds. And all files of a robot [bytes].
MAX_FILE, MAX_FILES = 50_000_100, 200_000_000
_SUFFIXES = (".stl", ".obj", ".dae")
# How a recorded URDF carries a hull: x, y, z of each vertex, before `scale`, little-endian.
_EMBEDDED = "data:application/x-float32-points;base64,"
_FILE_SCHEME = "file://"
# What a .dae counts its lengths in [m]; it stands before the meshes.
_COLLADA_UNIT, _ASSET_LENGTH = re.compile(rb"""<unit\b[^>]*?\bmeter\s*=\s*["']([^"']*)"""), 100_000
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
            points, hull, growth = convex_solid(given, scale)
        except (RuntimeError, ValueError, OSError) as fault:
            value = "embedded" if name.startswith("data:") else name or "without a filename"
            # Else of Coal, or of a path that no file can have.
            why = str(fault) if isinstance(fault, NoSolid) else "it cannot be read"
            faults.add("link", link, "collision mesh", value, why)
            return None
        if growth > 0.0:
            file = "embedded" if name.startswith("data:") else shortened(Path(name).name)
            self.notes.append(
                f"mesh {file}: its hull is simplified, at most {growth:.2g} of its width larger, "
                f"from a mesh of {len(given)} vertices to a hull of {len(points)}"
            )
        mesh.set("filename", _EMBEDDED + base64.b64encode(points.astype("<f4").tobytes()).decode())
        mesh.set("scale", " ".join(repr(float(number)) for number in scale))
        return hull

    def _points(self, name: str) -> Array:
        """Return the vertices of a file, before `scale`."""
        path = _path(name, self._directory)
        if path not in self._of_files:
            self._bytes += _size(path)
            if self._bytes > MAX_FILES:
                raise NoSolid(f"all files together have more than {MAX_FILES} bytes")
            unit = _unit(path)
            if unit != 1.0:
                self.notes.append(f"mesh {shortened(path.name)}: its lengths are in {unit:g} m")
            self._of_files[path] = _vertices(path, unit)
        return self._of_files[path]


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
        numbers = base64.b64decode(uri.removeprefix(_EMBEDDED), validate=True)
        return np.frombuffer(numbers, "<f4").reshape(-1, 3).astype(float)
    except (binascii.Error, ValueError):
        raise NoSolid("it is damaged") from None


def _path(name: str, directory: Path | None) -> Path:
    """Return where a file is that a URDF in a directory names."""
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
            if package.strip(".")  # neither nothing nor a way up
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
        status = path.stat()
    except (OSError, ValueError):
        raise NoSolid(f"there is no such file; {_LINES_NEED_NONE}") from None
    if not stat.S_ISREG(status.st_mode):
        raise NoSolid("it is no regular file")
    if status.st_size > MAX_FILE:
        raise NoSolid(
            f"it has {status.st_size} bytes, more than {MAX_FILE}: a million triangles; "
            "`collision` needs a simpler one"
        )
    return status.st_size


def _unit(path: Path) -> float:
    """Return what a file's lengths are in [m]. Coal passes over what Collada says of it."""
    if path.suffix.lower() != ".dae":
        return 1.0
    with path.open("rb") as file:
        said = _COLLADA_UNIT.search(file.read(_ASSET_LENGTH))
    try:
        unit = float(said[1]) if said else 1.0
    except ValueError:
        unit = math.nan
    if not 1.0 / LARGEST_SIZE <= unit <= LARGEST_SIZE:
        raise NoSolid("its <unit> is no number of metres that a mesh can be in")
    return unit


def _vertices(path: Path, unit: float) -> Array:
    try:
        found = coal.MeshLoader(coal.BV_AABB).load(str(path), np.ones(3))
        # As a recorded URDF carries them.
        return (unit * np.array(found.vertices(), float)).astype(np.float32).astype(float)
    except Exception as error:  # whatever Coal and Assimp throw
        raise NoSolid(f"it cannot be read: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    """Return what Coal says, without where in its code it says so."""
    words = str(error).partition("message: ")[2].split("\n")[0].strip()
    return "there is no mesh in it" if not words or words.startswith("Could not load") else words
