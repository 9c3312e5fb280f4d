"""Mesh files that hold scenes, against numbers written by hand and Assimp's own reading."""

import base64
import json
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
from test_meshes import BOX, CORNERS, body_of, dae, loaded
from test_wild_robots import robots_of_others

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.urdf.convex_hull import once
from ff_planner_ros.robot.urdf.mesh_files import MAX_FILE, MAX_NODES, MAX_POINTS
from ff_planner_ros.robot.urdf.meshes import vertices_of

# The origin, and 1, 2 and 3 m along x, y and z; a fifth vertex belongs to no triangle.
POINTS = struct.pack("<15f", 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 9, 9, 9)
FACES = struct.pack("<12H", 0, 1, 2, 0, 1, 3, 0, 2, 3, 1, 2, 3)
TURN = 0.5**0.5  # of a quaternion of 90 degrees


def gltf(**changes: Any) -> dict[str, Any]:
    """One node with a tetrahedron of x, y and z as long as they are in `POINTS`."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 60},
            {"buffer": 0, "byteOffset": 60, "byteLength": 24},
        ],
        "buffers": [{"byteLength": 84}],
    } | changes


def glb(document: dict[str, Any]) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text
    chunks += struct.pack("<I", len(POINTS + FACES)) + b"BIN\0" + POINTS + FACES
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def read(path: Path) -> Array:
    return vertices_of(path, Path.read_bytes)[0]


def require_corners(found: Array, wanted: list[list[float]]) -> None:
    np.testing.assert_allclose(once(found.round(5)), once(np.array(wanted)), atol=1e-6)


def test_a_gltf_file_is_in_metres_and_its_y_is_up(tmp_path: Path) -> None:
    """By its standard; RViz, Drake and Blender turn it so that z is up, as here."""
    (tmp_path / "a.glb").write_bytes(glb(gltf()))
    hull = body_of(loaded(tmp_path, '<mesh filename="a.glb" scale="1 1 10"/>')).solid
    require_corners(hull.points(), [[0, 0, 0], [1, 0, 0], [0, 0, 20], [0, -3, 0]])


def test_a_gltf_file_may_hold_its_numbers_or_have_them_beside_it(tmp_path: Path) -> None:
    text = base64.b64encode(POINTS + FACES).decode()
    (tmp_path / "the numbers.bin").write_bytes(POINTS + FACES)
    for uri in (f"data:application/octet-stream;base64,{text}", "the%20numbers.bin"):
        document = gltf(buffers=[{"byteLength": 84, "uri": uri}])
        (tmp_path / "a.gltf").write_text(json.dumps(document))
        require_corners(read(tmp_path / "a.gltf"), [[0, 0, 0], [1, 0, 0], [0, 0, 2], [0, -3, 0]])


def test_nodes_of_gltf_move_what_they_carry(tmp_path: Path) -> None:
    """Doubled, turned by 90 degrees about y, then moved; and once more by a matrix above."""
    moved = {"scale": [2, 2, 2], "rotation": [0, TURN, 0, TURN], "translation": [10, 20, 30]}
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 100, 200, 300, 1]  # by columns
    nodes = [{"matrix": matrix, "children": [1]}, {"mesh": 0} | moved]
    (tmp_path / "a.glb").write_bytes(glb(gltf(nodes=nodes)))
    # x becomes -z, z becomes x; then y up becomes z up.
    require_corners(
        read(tmp_path / "a.glb"),
        [[110, -330, 220], [110, -328, 220], [110, -330, 224], [116, -330, 220]],
    )


def test_a_collada_file_counts_in_its_unit_and_in_its_own_axes(tmp_path: Path) -> None:
    """As RViz, Gazebo, MoveIt and Pinocchio read it: arms are published that rely on it."""
    asset = b'<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>'
    file = dae(BOX * 100).replace(b"<asset><up_axis>Z_UP</up_axis></asset>", asset)
    (tmp_path / "a.dae").write_bytes(file)
    robot = loaded(tmp_path, '<mesh filename="a.dae"/>')
    # x from -10 to 10 cm, y from 0 to 40 cm, z from -30 to 30 cm
    wanted = [[x, y, z] for x in (-0.1, 0.1) for y in (0.0, 0.4) for z in (-0.3, 0.3)]
    require_corners(body_of(robot).solid.points(), wanted)
    notes = [note for note in robot.notes if note.startswith("mesh a.dae")]
    assert notes == [
        "mesh a.dae: its lengths are in 0.01 m",
        "mesh a.dae: its up_axis, Y_UP, is not applied, as RViz and Gazebo do not",
    ]


def test_nodes_of_collada_move_what_they_carry(tmp_path: Path) -> None:
    """First doubled, then turned by 90 degrees about z, then moved: the last one is nearest."""
    node = "<translate>1 2 3</translate>"
    moved = "<translate>10 0 0</translate><rotate>0 0 2 90</rotate><scale>2 2 2</scale>"
    (tmp_path / "a.dae").write_bytes(dae(BOX).replace(node.encode(), (moved + node).encode()))
    x, y, z = CORNERS.T
    wanted = np.stack([10 - 2 * y, 2 * x, 2 * z], axis=1)
    np.testing.assert_allclose(read(tmp_path / "a.dae"), once(wanted), atol=1e-5)


@pytest.mark.parametrize(
    "faces",
    ["f 1 2 3\nf 1/9 2/9 4/9", "f 1//2 2//2 \\\n3//2 4//2", "f -4 -3 -2 -1", "  f 4/1/1 3 2 1 \r"],
)
def test_an_obj_file_has_the_vertices_of_its_faces_and_reads_no_other(
    faces: str, tmp_path: Path
) -> None:
    lines = "mtllib /proc/kmsg\nv 0 0 0\nv 1 0 0 1.0\nv 0 2 0 0.5 0.5 0.5\n v\t0 0 3\nvn 1 0 0\n"
    beside = "" if "-" in faces else "v 9 9 9\n"
    (tmp_path / "a.obj").write_text(f"{lines}{beside}usemtl a\n{faces}\n", newline="")
    require_corners(read(tmp_path / "a.obj"), [[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])


REAL = [*("ur_description", "panda_description", "kinova_description")]


@pytest.mark.parametrize("robot", [*REAL, pytest.param(".", marks=pytest.mark.nightly)])
def test_files_of_others_are_read_as_assimp_reads_them(robot: str) -> None:
    """Of Collada files, the outermost vertices: Assimp may keep one of no face."""
    files = [
        file
        for file in sorted((robots_of_others() / "robots" / robot).rglob("*"))
        if file.suffix.lower() in (".stl", ".obj", ".dae") and file.stat().st_size <= MAX_FILE
    ]
    assert files
    for file in files:
        theirs = np.array(coal.MeshLoader(coal.BV_AABB).load(str(file), np.ones(3)).vertices())
        points, notes = vertices_of(file, Path.read_bytes)
        assert not any("lengths" in note for note in notes), file
        size = np.ptp(theirs, axis=0).max()
        for end in (np.min, np.max):
            np.testing.assert_allclose(end(points, 0), end(theirs, 0), atol=1e-6 * size, rtol=0)


def of_node(**changes: Any) -> dict[str, Any]:
    return gltf(nodes=[{"mesh": 0} | changes])


def of_points(**changes: Any) -> dict[str, Any]:
    return gltf(accessors=[gltf()["accessors"][0] | changes, gltf()["accessors"][1]])


def of_buffer(uri: str) -> dict[str, Any]:
    return gltf(buffers=[{"byteLength": 84, "uri": uri}])


DOUBLED = [{"mesh": 0}, *({"children": [k, k]} for k in range(40))]
EVIL: dict[str, tuple[dict[str, Any], str]] = {
    "four billion vertices": (of_points(count=4_000_000_000), "reaches beyond its buffer"),
    "vertices before the buffer": (of_points(byteOffset=-12), "reaches beyond its buffer"),
    "a vertex that is not there": (of_points(count=3), "names a vertex that is not there"),
    "vertices of no buffer": (
        gltf(accessors=[{"componentType": 5126, "count": 4_000_000_000, "type": "VEC3"}]),
        "sparse accessor",
    ),
    "vertices of whole numbers": (of_points(componentType=5123), "quantised positions"),
    "a node in itself": (of_node(children=[0]), f"more than {MAX_NODES} nodes"),
    "nodes that double": (
        gltf(nodes=DOUBLED, scenes=[{"nodes": [40]}]),
        f"more than {MAX_NODES} nodes",
    ),
    "meshes without end": (
        gltf(meshes=[{"primitives": 10**6 * [{"attributes": {"POSITION": 0}}]}]),
        "more than 1000000 elements",
    ),
    "a node of another kind": (gltf(nodes=[5]), "it is damaged"),
    "a skin": (of_node(skin=0), "a skin or instances, which are not read"),
    "instances": (of_node(extensions={"EXT_mesh_gpu_instancing": {}}), "a skin or instances"),
    "an extension": (
        gltf(extensionsRequired=["KHR_draco_mesh_compression"]),
        "it needs the extension KHR_draco_mesh_compression, which is not read",
    ),
    "the first glTF": (gltf(asset={"version": "1.0"}), "it is not glTF 2"),
    "no scene": (gltf(scenes=[]), "there is no mesh in it"),
    "lines": (
        gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 1}]}]),
        "there is no mesh in it",
    ),
    "a file above": (of_buffer("../secret.bin"), "it names a file that is not beside it"),
    "a file above, hidden": (of_buffer("%2e%2e/secret.bin"), "a file that is not beside it"),
    "a file anywhere": (of_buffer("/etc/passwd"), "it names a file that is not beside it"),
    "a file of the network": (of_buffer("http://localhost/a.bin"), "that is not beside it"),
    "a file that is gone": (of_buffer("gone.bin"), "there is no such file"),
    "data that are none": (of_buffer("data:;base64,?"), "it is damaged"),
}


@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("kind", EVIL)
def test_a_gltf_file_that_wants_to_harm_or_holds_what_is_not_read_is_refused_in_words(
    kind: str, tmp_path: Path
) -> None:
    document, words = EVIL[kind]
    (tmp_path / "secret.bin").write_bytes(POINTS + FACES)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "evil.glb").write_bytes(glb(document))
    with pytest.raises(InvalidInput, match=rf"evil\.glb: .*{re.escape(words)}"):
        loaded(tmp_path / "in", '<mesh filename="evil.glb"/>')


@pytest.mark.parametrize(
    "content", [b"", b"[" * 10**5, b"null", b"[1]", b"PK\3\4", b"glTF" + b"\xff" * 99, b"\xff\xfe{"]
)
def test_a_gltf_file_that_is_none_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "odd.gltf").write_bytes(content or b" ")
    with pytest.raises(InvalidInput, match=r"odd\.gltf: it cannot be read"):
        loaded(tmp_path, '<mesh filename="odd.gltf"/>')


def collada(nodes: str, numbers: str = "", faces: str = "0 1 2 3") -> bytes:
    text = dae(BOX).decode()
    count = len(numbers.split())
    if count:
        text = re.sub(r"<float_array.*?</float_array>", "", text, flags=re.S)
        array = f'<float_array id="pa" count="{count}">{numbers}</float_array>'
        text = text.replace('<source id="p">', f'<source id="p">{array}')
        text = text.replace('count="36"', f'count="{count // 3}"', 1)
        text = re.sub("<p>.*</p>", f"<p>{faces}</p>", text)
    return text.replace("<translate>", f"{nodes}<translate>", 1).encode()


TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
LARGEST: dict[str, Callable[[], bytes]] = {
    "numbers.dae": lambda: collada("", "11 " * 16_500_000),
    "indices.dae": lambda: collada("", "0 0 0 1 0 0 0 1 0 0 0 1", "0 1 2 3 " * 6_200_000),
    "moves.dae": lambda: collada("<scale>1 1 1</scale>" * 990_000),
    "elements.dae": lambda: collada("<a/>" * 12_000_000),
    "polygon.obj": lambda: TETRAHEDRON + b"f " + b"1 2 3 4 " * 6_200_000,
    "long_numbers.obj": lambda: TETRAHEDRON * 5 + b"f " + b"11 " * 16_600_000,
    "vertices.obj": lambda: b"v 0 0 0\n" * (MAX_POINTS - 1) + b"f 1 2\n" * 4_300_000,
    "words.stl": lambda: b"vertex 1 2 3\n" * 3_800_000,
    "keys.gltf": lambda: b"{" + b",".join(b'"%x":0' % k for k in range(4_400_000)) + b"}",
    "strings.gltf": lambda: b"[" + b'"ab",' * 9_900_000 + b"1]",
    "floats.gltf": lambda: b"[" + b"1.5," * 12_400_000 + b"1]",
}
# Of each reader one, the dearest where it is not alike.
DEAREST = ("moves.dae", "vertices.obj", "words.stl", "strings.gltf")
# Seconds are counted by what the machine needs for a work of the same kind at that time: ten
# seconds where the limit was set are twelve times five million numbers.
IN_LIMITS = """
import math, resource, sys, time
from pathlib import Path
import numpy as np
import scipy.spatial
from ff_planner_ros.robot.urdf.convex_hull import NoSolid
from ff_planner_ros.robot.urdf.meshes import Meshes
begun = time.process_time()
words = (b"11 " * 5_000_000).split()
np.fromiter(map(float, words), float, len(words))
ended = time.process_time()
del words
seconds = math.ceil(ended + 12.0 * (ended - begun))
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + 2 * 10**9, held + 2 * 10**9))
file = Path(sys.argv[1])
try:
    Meshes(file.parent).convex(file.name, np.ones(3))
except NoSolid as refused:
    assert "memory" not in str(refused), refused
"""


@pytest.mark.law("FILE-02")
@pytest.mark.ci
@pytest.mark.parametrize(
    "name",
    [one if one in DEAREST else pytest.param(one, marks=pytest.mark.nightly) for one in LARGEST],
)
def test_no_file_costs_more_than_ten_seconds_and_two_gigabytes(name: str, tmp_path: Path) -> None:
    """The system ends the process that takes more time, and gives it no more memory."""
    content = LARGEST[name]()
    assert 10**7 < len(content) <= MAX_FILE
    (tmp_path / name).write_bytes(content)
    program = [sys.executable, "-c", IN_LIMITS, str(tmp_path / name)]
    ended = subprocess.run(program, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
