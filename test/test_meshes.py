"""Meshes of a URDF as convex solids, against their own vertices, and files that are none."""

import base64
import pickle
import re
import struct
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from robots import random_urdf
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.convex_hull import MAX_VERTICES, convex_solid

ENDS = ("bus", "tool")
RNG = np.random.default_rng(5)
# Eight corners and points inside and on faces, as triangles; a box of 0.2 x 0.4 x 0.6.
CORNERS = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (0.0, 0.4) for z in (-0.3, 0.3)])
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
FACES += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]


def stl(triangles: Array) -> bytes:
    rows = np.zeros(
        len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("no", "<u2")]
    )
    rows["corners"] = triangles
    return bytes(80) + struct.pack("<I", len(triangles)) + rows.tobytes()


def obj(triangles: Array) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in triangles.reshape(-1, 3).tolist()]
    lines += [f"f {3 * k + 1} {3 * k + 2} {3 * k + 3}" for k in range(len(triangles))]
    return "\n".join(lines).encode()


def dae(triangles: Array) -> bytes:
    """Moved by a node's translation of (1, 2, 3)."""
    numbers = " ".join(map(repr, (triangles.reshape(-1, 3) - [1, 2, 3]).ravel().tolist()))
    count = 3 * len(triangles)
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="{3 * count}">{numbers}</float_array><technique_common>
<accessor source="#pa" count="{count}" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(triangles)}"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{" ".join(map(str, range(count)))}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>1 2 3</translate>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


BOX = CORNERS[np.array(FACES)]
WRITERS = {"stl": stl, "obj": obj, "dae": dae}


def urdf_with(mesh: str, link: str = "link_2") -> str:
    """The arm with a mesh on a link, and a sphere on the first one."""
    text = random_urdf(joints=4, seed=3)
    for name, solid in (("link_1", '<sphere radius="0.1"/>'), (link, mesh)):
        collision = f"<collision><geometry>{solid}</geometry></collision>"
        text = text.replace(f'<link name="{name}">', f'<link name="{name}">{collision}')
    return text


def loaded(directory: Path, mesh: str) -> Robot:
    urdf = directory / "arm.urdf"
    urdf.write_text(urdf_with(mesh))
    return load_robot(urdf, *ENDS)


def body_of(robot: Robot, link: str = "link_2") -> Body:
    return next(body for body in robot.bodies if body.link == link)


@pytest.mark.parametrize("kind", WRITERS)
def test_the_hull_of_a_mesh_has_its_corners_and_its_volume(kind: str, tmp_path: Path) -> None:
    inside = RNG.uniform(-0.1, 0.1, (40, 3, 3)) * [1.0, 1.0, 2.0] + [0.0, 0.2, 0.0]
    (tmp_path / f"box.{kind.upper()}").write_bytes(WRITERS[kind](np.concatenate([BOX, inside])))
    scaled = loaded(tmp_path, f'<mesh filename="box.{kind.upper()}" scale="2 -1 0.5"/>')
    hull = body_of(scaled).solid
    assert isinstance(hull, coal.Convex)
    wanted = np.unique(CORNERS * [2.0, -1.0, 0.5], axis=0)
    np.testing.assert_allclose(np.unique(hull.points(), axis=0), wanted, atol=1e-6)
    assert hull.computeVolume() == pytest.approx(0.2 * 0.4 * 0.6, rel=1e-6)
    assert scaled.notes == body_notes(scaled)


def body_notes(robot: Robot) -> tuple[str, ...]:
    """What is said of links without solids: link_3 and link_4 have none here."""
    return tuple(note for note in robot.notes if note.startswith("without a <collision>"))


@pytest.mark.parametrize(
    "name",
    [
        "meshes/box.stl",
        *("file://{here}/meshes/box.stl", "file://localhost{here}/meshes/box.stl"),
        *("package://arm/meshes/box.stl", "package://beside/box.stl"),
    ],
)
def test_a_mesh_is_found_from_the_urdf(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir("/")
    here = tmp_path / "arm" / "urdf"
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    (here / "meshes").mkdir(parents=True)
    (tmp_path / "beside").mkdir()
    for directory in (here / "meshes", here.parent / "meshes", tmp_path / "beside"):
        (directory / "box.stl").write_bytes(stl(BOX))
    assert (
        body_of(loaded(here, f'<mesh filename="{name.format(here=here)}"/>')).solid.num_points == 8
    )


def test_a_package_is_found_in_the_workspace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = tmp_path / "install/share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "arm_description").touch()
    share = tmp_path / "install/share/arm_description"
    share.mkdir()
    (share / "box.stl").write_bytes(stl(BOX))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    robot = loaded(tmp_path, '<mesh filename="package://arm_description/box.stl"/>')
    assert body_of(robot).solid.num_points == 8


def test_what_is_handed_on_needs_no_files_and_is_the_same_to_the_last_bit(tmp_path: Path) -> None:
    points = RNG.normal(size=(300, 3, 3))
    (tmp_path / "cloud.stl").write_bytes(stl(points))
    robot = loaded(tmp_path, '<mesh filename="cloud.stl" scale="0.1 0.13 0.001"/>')
    (tmp_path / "cloud.stl").unlink()
    built = robot_from_urdf_text(robot.drawn_urdf, *ENDS)
    for again in (built, pickle.loads(pickle.dumps(robot))):
        assert again.drawn_urdf == robot.drawn_urdf
        assert (again.pairs, again.may_touch) == (robot.pairs, robot.may_touch)
        for ours, theirs in zip(again.bodies, robot.bodies, strict=True):
            assert ours.solid == theirs.solid
            assert ours.placement_in_joint == theirs.placement_in_joint
            assert ours.radius == theirs.radius


def sphere(rows: int) -> Array:
    """Triangles of a unit sphere."""
    down, round_ = np.linspace(0.01, np.pi - 0.01, rows), np.linspace(0.0, 2 * np.pi, rows)
    a, b = np.meshgrid(down, round_, indexing="ij")
    grid = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    return np.concatenate([quads[:, :, face].reshape(-1, 3, 3) for face in ((0, 1, 2), (0, 2, 3))])


@pytest.mark.parametrize("stretched", [(1.0, 1.0, 1.0), (50.0, 1.0, 0.1)], ids=["ball", "blade"])
def test_a_hull_of_very_many_corners_is_simplified_to_one_that_holds_it(
    stretched: tuple[float, float, float], tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    given = sphere(max(120, times(0, 300))) @ (
        np.diag(stretched) @ pin.exp3(np.array([0.3, -0.2, 0.9]))
    )
    (tmp_path / "ball.stl").write_bytes(stl(given))
    robot = loaded(tmp_path, '<mesh filename="ball.stl"/>')
    hull = body_of(robot).solid
    assert hull.num_points <= MAX_VERTICES
    (told,) = [note for note in robot.notes if "ball.stl" in note and "simplified" in note]
    assert re.search(r"at most 0.0\d+ of its width and 0.0\d+ of its volume larger", told)
    corners = np.unique(given.astype(np.float32).reshape(-1, 3), axis=0)
    for normal, offset in zip(hull.normals(), hull.offsets(), strict=True):
        assert (corners @ normal + offset).max() <= 1e-7
    # An ellipsoid of three per cent more, at most, holds it.
    turned = np.linalg.inv(np.diag(stretched) @ pin.exp3(np.array([0.3, -0.2, 0.9])))
    assert np.linalg.norm(hull.points() @ turned, axis=1).max() < 1.03
    again = robot_from_urdf_text(robot.drawn_urdf, *ENDS)
    assert body_of(again).solid == hull
    assert not any("simplified" in note for note in again.notes)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "it is empty"),
        (b"garbage" * 100, "cannot be read"),
        (b"solid a\nendsolid a\n", "cannot be read"),
        (bytes(80) + b"\xff\xff\xff\xff", "cannot be read"),
        (stl(BOX)[:-60], "cannot be read"),
        (stl(BOX * [1.0, 1.0, 0.0]), "it is flat"),
        (stl(BOX * [1.0, 0.0, 0.0]), "there is no mesh in it"),
        (stl(BOX * [1.0, 1.0, 1e-9]), "it is flat"),
        (stl(BOX * 0.0), "there is no mesh in it"),
        (stl(BOX * [1.0, 1e-9, 1e-9]), "it is flat"),
        (stl(BOX * 1e6), "none further than 10000 m"),
        (stl(BOX[:1]), "it is flat"),
    ],
)
def test_a_file_that_holds_no_solid_is_refused_by_its_name(
    content: bytes, words: str, tmp_path: Path
) -> None:
    (tmp_path / "odd.stl").write_bytes(content)
    with pytest.raises(InvalidInput, match=rf"link 'link_2' collision mesh is odd\.stl: .*{words}"):
        loaded(tmp_path, '<mesh filename="odd.stl"/>')


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ('<mesh filename="gone.stl"/>', "gone.stl: there is no such file"),
        ('<mesh filename="package://gone/a.stl"/>', "no package 'gone' with this file"),
        ('<mesh filename="http://example.org/a.stl"/>', "it must be a path, file:// or package://"),
        ('<mesh filename="/etc/passwd"/>', "it must be a file that ends in .stl, .obj, .dae"),
        ('<mesh filename="directory.stl"/>', "it is a directory, not a file"),
        ('<mesh filename="empty.stl"/>', "it is empty"),
        ('<mesh filename="box.stl" scale="1 1"/>', "its scale is '1 1'"),
        ('<mesh filename="box.stl" scale="1 0 1"/>', "none 0"),
        ('<mesh filename="box.stl" scale="1 nan 1"/>', "its scale is '1 nan 1'"),
        ('<mesh filename="box.stl" scale="1 1 1e-9"/>', "it is flat"),
        ("<mesh/>", "without a filename"),
        ('<mesh filename="file:///a%00b.stl"/>', "it cannot be read"),
        ('<mesh filename="loop.stl"/>', "collision mesh is loop.stl"),
        (f'<mesh filename="{"a" * 300}.stl"/>', "there is no such file"),
        (f'<mesh filename="package://arm/{"a" * 300}.stl"/>', "no package 'arm' with this file"),
        ('<mesh filename="package://../a.stl"/>', "no package '..' with this file"),
        ('<mesh filename="package:///a.stl"/>', "no package '' with this file"),
        ('<mesh filename="big.stl"/>', "a million triangles"),
        ('<mesh filename="data:application/x-float32-points;base64,AAA"/>', "it is damaged"),
        ('<mesh filename="data:application/x-float32-points;base64,"/>', "it must have vertices"),
    ],
)
def test_a_mesh_that_cannot_be_taken_is_refused_in_words(
    mesh: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "box.stl").write_bytes(stl(BOX))
    (tmp_path / "directory.stl").mkdir()
    (tmp_path / "empty.stl").symlink_to("/proc/kmsg")  # says so, and lets a reader wait for ever
    (tmp_path / "loop.stl").symlink_to(tmp_path / "loop.stl")
    with (tmp_path / "big.stl").open("wb") as file:
        file.truncate(10**9)  # a hole: nothing is written
    with pytest.raises(InvalidInput, match=re.escape(words)):
        loaded(tmp_path, mesh)
    (tmp_path / "arm.urdf").write_text(urdf_with(mesh))
    assert load_robot(tmp_path / "arm.urdf", *ENDS, geometry=Geometry.LINES).bodies == ()


def test_a_urdf_that_is_not_from_a_file_reads_none(tmp_path: Path) -> None:
    """A recorded one, or one that came over the network: it must not tell of files here."""
    (tmp_path / "box.stl").write_bytes(stl(BOX))
    for name in (f"{tmp_path}/box.stl", f"file://{tmp_path}/box.stl", f"{tmp_path}/gone.stl"):
        with pytest.raises(InvalidInput, match="this URDF is not from a file"):
            robot_from_urdf_text(urdf_with(f'<mesh filename="{name}"/>'), *ENDS)


def test_embedded_points_of_any_number_are_a_hull_of_few() -> None:
    points = RNG.normal(size=(20_000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    text = base64.b64encode(points.astype("<f4").tobytes()).decode()
    mesh = f'<mesh filename="data:application/x-float32-points;base64,{text}"/>'
    robot = robot_from_urdf_text(urdf_with(mesh), *ENDS)
    assert body_of(robot).solid.num_points <= MAX_VERTICES
    assert len(robot.drawn_urdf) < 100_000


def test_a_mesh_in_millimetres_may_be_as_long_as_a_station(tmp_path: Path) -> None:
    (tmp_path / "boom.stl").write_bytes(stl(BOX * [2e5, 1.0, 1e3]))
    robot = loaded(tmp_path, '<mesh filename="boom.stl" scale="0.001 0.1 0.001"/>')
    assert body_of(robot).solid.computeVolume() == pytest.approx(40.0 * 0.04 * 0.6, rel=1e-6)


@pytest.mark.parametrize(("unit", "metres"), [("0.001", 1e-3), ("0.0254", 0.0254), ("1", 1.0)])
def test_a_collada_file_says_what_its_lengths_are_in(
    unit: str, metres: float, tmp_path: Path
) -> None:
    up = f'<asset><unit name="one" meter="{unit}"/>'.encode()
    (tmp_path / "box.dae").write_bytes(dae(BOX / metres).replace(b"<asset>", up))
    robot = loaded(tmp_path, '<mesh filename="box.dae"/>')
    points = np.unique(np.round(body_of(robot).solid.points(), 6), axis=0)
    np.testing.assert_allclose(points, np.unique(CORNERS, axis=0), atol=2e-6)
    assert any("its lengths are in" in note for note in robot.notes) == (metres != 1.0)
    again = robot_from_urdf_text(robot.drawn_urdf, *ENDS)
    np.testing.assert_array_equal(body_of(again).solid.points(), body_of(robot).solid.points())


@pytest.mark.parametrize("unit", ["inch", "0", "-1", "nan"])
def test_a_collada_file_of_an_impossible_unit_is_refused(unit: str, tmp_path: Path) -> None:
    said = f'<asset><unit meter="{unit}"/>'.encode()
    (tmp_path / "box.dae").write_bytes(dae(BOX).replace(b"<asset>", said))
    with pytest.raises(InvalidInput, match=r"box\.dae: its <unit> is no number of metres"):
        loaded(tmp_path, '<mesh filename="box.dae"/>')


def test_a_file_on_many_links_is_read_once(tmp_path: Path) -> None:
    (tmp_path / "ball.stl").write_bytes(stl(sphere(60)))
    both = urdf_with('<mesh filename="ball.stl"/>', "bus").replace(
        '<link name="link_2">',
        '<link name="link_2"><collision><geometry><mesh filename="ball.stl" scale="0.1 0.1 0.1"/>'
        "</geometry></collision>",
    )
    (tmp_path / "arm.urdf").write_text(both)
    robot = load_robot(tmp_path / "arm.urdf", *ENDS)
    bus, link = body_of(robot, "bus").solid, body_of(robot).solid
    np.testing.assert_allclose(link.points(), 0.1 * bus.points(), rtol=1e-12)


def tube(count: int) -> Array:
    """Corners of a long cylinder."""
    turn = np.linspace(0.0, 2.0 * np.pi, count // 2, endpoint=False)
    ring = np.stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), np.ones_like(turn)], axis=1)
    return np.concatenate([ring, ring * [1.0, 1.0, -1.0]])


def pyramid(count: int) -> Array:
    """Corners of a base, and the apex, whose edges are more than Coal takes at one corner."""
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    base = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    return np.vstack([base, [0.0, 0.0, 0.5]])


def far(count: int) -> Array:
    """A small ball far away, where single precision is coarse."""
    points = RNG.normal(size=(count, 3))
    return np.array(0.01 * points / np.linalg.norm(points, axis=1)[:, None] + [900.0, -500.0, 3.0])


@pytest.mark.parametrize("shape", [tube, pyramid, far])
def test_a_simplified_solid_is_as_near_as_the_mesh_or_nearer_by_what_its_note_says(
    shape: Callable[[int], Array],
) -> None:
    """Distances of a ball, by Coal, against those of the mesh's whole hull by least squares."""
    points = shape(3000).astype(np.float32).astype(float)
    whole = ConvexHull(points)
    corners, solid, growth = convex_solid(points, np.ones(3))
    simple = ConvexHull(corners)
    assert len(corners) < 500
    assert growth < 0.03
    assert whole.volume <= simple.volume <= (1.0 + growth) ** 3 * whole.volume
    middle, size = points.mean(axis=0), np.ptp(points, axis=0).max()
    ball, here, wanted = coal.Sphere(0.1 * size), coal.Transform3s(), coal.DistanceRequest()
    for way in RNG.normal(size=(50, 3)):
        center = middle + 2.0 * size * way / np.linalg.norm(way)
        found = coal.DistanceResult()
        coal.distance(solid, here, ball, coal.Transform3s(np.eye(3), center), wanted, found)
        true = distance_from_hull(points[whole.vertices] - center) - ball.radius
        assert true - growth * size - 1e-6 * size <= found.min_distance <= true + 1e-9 * size


def distance_from_hull(points: Array) -> float:
    """Distance of the origin from the hull of points around which it is not."""
    weights, _ = nnls(np.vstack([points.T, np.ones(len(points))]), np.array([0.0, 0.0, 0.0, 1.0]))
    return float(np.linalg.norm(points.T @ (weights / weights.sum())))
