"""Vertices of mesh files: STL, OBJ, Collada and glTF, within limits of bytes, vertices and parts.

A file from outside may hold anything. Nothing here recurses, and nothing is reserved by a number
that a file says, so that the limits bound time and memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.urdf.convex_hull import NoSolid

# Largest file, a binary STL of a million triangles (two seconds), and all of a robot [bytes].
MAX_FILE, MAX_FILES = 50_000_100, 200_000_000
# Of a file: vertices, those of a part as often as a scene has it; XML elements or JSON containers;
# nodes and meshes of a scene, as often as others refer to them; vertices and indices that meshes
# refer to, which may be the same ones.
MAX_POINTS, MAX_ELEMENTS, MAX_NODES, MAX_REFERRED = 3_000_000, 1_000_000, 100_000, 30_000_000

_STL_HEAD = 84  # [bytes] a text of any kind, and the number of triangles
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_VERTEX = re.compile(rb"^[ \t]*vertex[ \t]+(.*)$", re.M | re.I)
_OBJ_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(\S+[ \t]+\S+[ \t]+\S+)", re.M)
_OBJ_FACE = re.compile(rb"^[ \t]*f[ \t]+(.*)$", re.M)
_OBJ_INDEX = re.compile(rb"(?<!\S)[+-]?\d+")  # of 7/8/9, the vertex alone

Node = TypeVar("Node")


def stl_vertices(data: bytes) -> Array:
    """Return the corners of all triangles that have an area. Shape (vertices, 3)."""
    count = int.from_bytes(data[_STL_HEAD - 4 : _STL_HEAD], "little")
    if len(data) == _STL_HEAD + count * _STL_TRIANGLE.itemsize:
        corners = np.frombuffer(data, _STL_TRIANGLE, offset=_STL_HEAD)["corners"]
    else:
        corners = numbers_in(b" ".join(_STL_VERTEX.findall(data))).reshape(-1, 3, 3)
    turned = corners[:, [1, 2, 0]]
    solid: Array = corners[(corners != turned).any(axis=2).all(axis=1)]
    return solid.reshape(-1, 3)


def obj_vertices(data: bytes) -> Array:
    """Return the vertices of all faces; other files that it names are not read."""
    data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    rows = _OBJ_VERTEX.findall(data)
    require_few(len(rows), MAX_POINTS, "vertices")
    points = numbers_in(b" ".join(rows)).reshape(-1, 3)
    indices = _OBJ_INDEX.findall(b" ".join(_OBJ_FACE.findall(data)))
    named = np.fromiter(map(int, indices), np.int64, len(indices))
    if (named < 0).any():  # counted back from where the face stands: all count
        return points
    return used(points, named - 1)


def used(points: Array, indices: NDArray[np.int64]) -> Array:
    """Return the points with these indices, each once, in the order of the points."""
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(points):
        raise NoSolid("it cannot be read: a face names a vertex that is not there")
    named = np.zeros(len(points), bool)
    named[indices] = True
    return points[named]


class Scene(Generic[Node]):
    """The nodes of a file, each of which may have meshes and carry others."""

    def __init__(self) -> None:
        """Begin to count what parts of the file refer to."""
        self._referred = 0

    def part(self, node: Node) -> tuple[Array, Sequence[Array], Sequence[Node]]:
        """Return transformation, shape (4, 4), meshes' vertices, and the nodes that it carries."""
        raise NotImplementedError

    def used(self, points: Array, indices: NDArray[np.int64]) -> Array:
        """Return the points with these indices, each once, and count both."""
        self._referred += len(points) + len(indices)
        require_few(self._referred, MAX_REFERRED, "vertices and indices that its meshes refer to")
        return used(points, indices)

    def vertices(self, roots: Iterable[Node], place: Array) -> Array:
        """Return the vertices of all nodes, each mesh as often as a node has it.

        Args:
            place: Transformation of the scene. Shape (4, 4).
        """
        ahead = [(node, place) for node in roots]
        found, nodes, points = [np.empty((0, 3))], len(ahead), 0
        known = dict[Node, tuple[Array, Sequence[Array], Sequence[Node]]]()
        while ahead:
            node, above = ahead.pop()
            if node not in known:
                known[node] = self.part(node)
            local, meshes, carried = known[node]
            nodes, points = nodes + len(meshes) + len(carried), points + sum(map(len, meshes))
            require_few(nodes, MAX_NODES, "nodes in its scene, which may hold each other")
            require_few(points, MAX_POINTS, "vertices in its scene")
            place = above @ local
            found += [mesh @ place[:3, :3].T + place[:3, 3] for mesh in meshes]
            ahead += [(one, place) for one in carried]
        return np.concatenate(found)


def numbers_in(text: bytes | str) -> Array:
    """Return the numbers of a text between white space."""
    words = text.split()
    return np.fromiter(map(float, words), float, len(words))


def require_few(count: int, most: int, what: str) -> None:
    """Refuse more things than a file may have."""
    if count > most:
        raise NoSolid(f"it has more than {most} {what}")
