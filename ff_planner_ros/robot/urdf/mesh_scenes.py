"""Vertices of mesh files that hold a scene of nodes: Collada and glTF."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.urdf.convex_hull import LARGEST_SIZE, NoSolid
from ff_planner_ros.robot.urdf.mesh_files import (
    MAX_ELEMENTS,
    Scene,
    numbers_in,
    require_few,
)
from ff_planner_ros.robot.urdf.urdf_faults import shortened

# Elements of Collada whose vertices a mesh has; lines have no area.
_FACES = ("triangles", "tristrips", "trifans", "polylist", "polygons")
_TRIANGLES = (4, 5, 6)  # modes of glTF: apart, in a strip, in a fan
_NUMBERS = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # by glTF's componentType
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
# Extensions of glTF that say nothing of vertices.
_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
# glTF has Y up and Z ahead, links have Z up; as RViz, Drake and Blender turn it.
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def collada_vertices(data: bytes, notes: list[str]) -> Array:
    """Return the vertices of a Collada file's scene [m].

    Args:
        notes: Gets one on a unit that is not a metre, and one on an up axis that is not Z.
    """
    root = _xml(data)
    unit = _unit(root.find("asset/unit"))
    if unit != 1.0:
        notes.append(f"its lengths are in {unit:g} m")
    up = root.findtext("asset/up_axis", "Z_UP").strip()
    if up != "Z_UP":
        notes.append(f"its up_axis, {up[:20]}, is not applied, as RViz and Gazebo do not")
    collada, shown = _Collada(root), root.find("scene/instance_visual_scene")
    scene = root.find(".//visual_scene") if shown is None else collada.named(shown, "url")
    roots = [] if scene is None else [scene]
    return collada.vertices(roots, np.diag([unit, unit, unit, 1.0]))


class _Collada(Scene[Element]):
    def __init__(self, root: Element) -> None:
        super().__init__()
        self._ids = {name: element for element in root.iter() if (name := element.get("id"))}
        self._known = dict[Element, Array]()  # by geometry and by source

    def named(self, element: Element, key: str) -> Element:
        """Return the element that an attribute refers to."""
        url = element.get(key, "")
        if not url.startswith("#") or url[1:] not in self._ids:
            raise NoSolid(f"it cannot be read: {shortened(url)!r} is not in it")
        return self._ids[url[1:]]

    def part(self, node: Element) -> tuple[Array, list[Array], list[Element]]:
        place, meshes, carried = np.eye(4), list[Array](), list[Element]()
        for child in node:
            match child.tag:
                case "instance_geometry":
                    meshes.append(self._geometry(self.named(child, "url")))
                case "node":
                    carried.append(child)
                case "instance_node":
                    carried.append(self.named(child, "url"))
                case "matrix" | "translate" | "rotate" | "scale":
                    _move(place, child)
                case "instance_controller" | "lookat" | "skew":
                    raise NoSolid(f"it has an <{child.tag}>, which is not read")
        return place, meshes, carried

    def _geometry(self, geometry: Element) -> Array:
        """Return the vertices of a mesh that belong to a face."""
        if geometry in self._known:
            return self._known[geometry]
        mesh = geometry.find("mesh")
        if mesh is None:
            raise NoSolid("it has a <geometry> that is no <mesh>")
        found = [np.empty((0, 3))]
        for faces in (child for child in mesh if child.tag in _FACES):
            inputs = {one.get("semantic"): one for one in faces.findall("input")}
            first, *others = (int(one.get("offset", "0")) for one in inputs.values())
            first, step = int(inputs["VERTEX"].get("offset", "0")), max(first, *others, 0) + 1
            position = self.named(inputs["VERTEX"], "source").find("input[@semantic='POSITION']")
            indices = [numbers_in(one.text or "")[first::step] for one in faces.iter("p")]
            if position is not None and indices:
                points = self._positions(self.named(position, "source"))
                found.append(self.used(points, np.concatenate(indices).astype(np.int64)))
        self._known[geometry] = np.concatenate(found)
        return self._known[geometry]

    def _positions(self, source: Element) -> Array:
        if source in self._known:
            return self._known[source]
        accessor = source.find("technique_common/accessor")
        if accessor is None:
            raise NoSolid("it cannot be read: a source has no accessor")
        array = self.named(accessor, "source")
        numbers, said = numbers_in(array.text or ""), int(array.get("count", "0"))
        count, step = int(accessor.get("count", "0")), int(accessor.get("stride", "1"))
        first = int(accessor.get("offset", "0"))
        if said != len(numbers) or step < 3 or first < 0 or first + count * step > said:
            raise NoSolid("it cannot be read: an array has fewer or more numbers than it says")
        rows: Array = numbers[first : first + count * step].reshape(count, step)
        self._known[source] = rows[:, :3]
        return self._known[source]


def _xml(data: bytes) -> Element:
    """Return the tree of an XML file, without its namespaces."""
    builder, parser, count = TreeBuilder(), expat.ParserCreate(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        require_few(count, MAX_ELEMENTS, "elements")
        builder.start(tag.rpartition(":")[2], attributes)

    def document_type(*_: Any) -> None:
        # An entity of a few bytes may stand for gigabytes.
        raise NoSolid("it has a <!DOCTYPE>, which no Collada file needs")

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = start, document_type
    parser.EndElementHandler = lambda tag: builder.end(tag.rpartition(":")[2])
    parser.CharacterDataHandler, parser.buffer_text = builder.data, True
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise NoSolid(f"it cannot be read: {error}") from None
    return builder.close()


def _unit(said: Element | None) -> float:
    try:
        unit = 1.0 if said is None else float(said.get("meter", "1"))
    except ValueError:
        unit = math.nan
    if not 1.0 / LARGEST_SIZE <= unit <= LARGEST_SIZE:
        raise NoSolid("its <unit> is no number of metres that a mesh can be in")
    return unit


def _move(place: Array, element: Element) -> None:
    """Put the transformation of a node's element after those before it. Changes `place`, (4, 4)."""
    given = numbers_in(element.text or "")
    if element.tag == "matrix":
        place[:] = place @ given.reshape(4, 4)
        return
    vector = given[:3].reshape(3)
    if element.tag == "translate":
        place[:, 3] += place[:, :3] @ vector
    elif element.tag == "scale":
        place[:, :3] *= vector
    else:
        turn = pin.AngleAxis(math.radians(given[3]), _unit_vector(vector)).matrix()
        place[:, :3] = place[:, :3] @ turn


def _unit_vector(vector: Array) -> Array:
    return np.array(vector / np.linalg.norm(vector))


def gltf_vertices(data: bytes, read: Callable[[str], bytes]) -> Array:
    """Return the vertices of a glTF file's scene, turned to have Z up [m].

    Args:
        read: Returns the content of a file by a path from this one.
    """
    text, binary = _chunks(data)
    require_few(text.count(b"{") + text.count(b"["), MAX_ELEMENTS, "elements")
    document = json.loads(text)
    if not document["asset"]["version"].startswith("2."):
        raise NoSolid("it cannot be read: it is not glTF 2")
    for extension in document.get("extensionsRequired", ()):
        if not extension.startswith(_LOOKS):
            raise NoSolid(f"it needs the extension {shortened(extension)}, which is not read")
    scenes = document.get("scenes", ())
    roots = scenes[document.get("scene", 0)].get("nodes", ()) if scenes else ()
    return _Gltf(document, binary, read).vertices(roots, _Y_UP)


class _Gltf(Scene[int]):
    def __init__(
        self, document: Mapping[str, Any], binary: bytes, read: Callable[[str], bytes]
    ) -> None:
        super().__init__()
        self._document, self._binary, self._read = document, binary, read
        self._buffers, self._known = dict[int, bytes](), dict[int, list[Array]]()  # by mesh

    def part(self, number: int) -> tuple[Array, list[Array], list[int]]:
        node = self._document["nodes"][number]
        if "skin" in node or "EXT_mesh_gpu_instancing" in node.get("extensions", ()):
            raise NoSolid("it has a node with a skin or instances, which are not read")
        mesh = node.get("mesh")
        return _placed(node), [] if mesh is None else self._mesh(mesh), node.get("children", [])

    def _mesh(self, number: int) -> list[Array]:
        if number not in self._known:
            self._known[number] = [
                self._primitive(one)
                for one in self._document["meshes"][number]["primitives"]
                if one.get("mode", 4) in _TRIANGLES
            ]
        return self._known[number]

    def _primitive(self, primitive: Mapping[str, Any]) -> Array:
        """Return the vertices of a primitive that belong to a triangle."""
        points = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
        if "indices" not in primitive:
            return self.used(points, np.arange(len(points)))
        indices = self._accessor(primitive["indices"], "SCALAR").ravel()
        return self.used(points, indices.astype(np.int64))

    def _accessor(self, number: int, kind: str) -> Array:
        """Return numbers of a buffer. Shape (count, width)."""
        accessor = self._document["accessors"][number]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise NoSolid("it has a sparse accessor, which is not read")
        if accessor["type"] != kind or (kind == "VEC3") != (accessor["componentType"] == 5126):
            raise NoSolid("it has quantised positions, which are not read")
        view = self._document["bufferViews"][accessor["bufferView"]]
        start, end = view.get("byteOffset", 0), view["byteLength"]
        content = memoryview(self._buffer(view["buffer"]))[start : start + end]
        item, width = np.dtype(_NUMBERS[accessor["componentType"]]), _WIDTHS[kind]
        count, first = accessor["count"], accessor.get("byteOffset", 0)
        step = view.get("byteStride", item.itemsize * width)
        last = first + step * (count - 1) + item.itemsize * width
        if count < 1 or first < 0 or step < item.itemsize * width or last > len(content):
            raise NoSolid("it cannot be read: an accessor reaches beyond its buffer")
        return np.ndarray((count, width), item, content, first, (step, item.itemsize))

    def _buffer(self, number: int) -> bytes:
        if number not in self._buffers:
            uri = self._document["buffers"][number].get("uri")
            if uri is None:
                content = self._binary
            elif uri.startswith("data:"):
                content = base64.b64decode(uri.partition(",")[2], validate=True)
            else:
                content = self._read(unquote(uri))
            self._buffers[number] = content
        return self._buffers[number]


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary part of a file."""
    if data[:4] != b"glTF":
        return data, b""
    parts, at = {b"JSON": b"", b"BIN\0": b""}, 12
    while at + 8 <= len(data):
        size, kind = int.from_bytes(data[at : at + 4], "little"), data[at + 4 : at + 8]
        if at + 8 + size > len(data):
            raise NoSolid("it cannot be read: it is cut off")
        parts.setdefault(kind, b"")
        parts[kind] = parts[kind] or data[at + 8 : at + 8 + size]
        at += 8 + size
    return parts[b"JSON"], parts[b"BIN\0"]


def _placed(node: Mapping[str, Any]) -> Array:
    """Return the transformation of a glTF node. Shape (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    place = np.eye(4)
    turn = np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), float)
    turned = pin.Quaternion(_unit_vector(turn.reshape(4))).toRotationMatrix()
    place[:3, :3] = turned * np.array(node.get("scale", (1.0, 1.0, 1.0)), float).reshape(3)
    place[:3, 3] = np.array(node.get("translation", (0.0, 0.0, 0.0)), float).reshape(3)
    return place
