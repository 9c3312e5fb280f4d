"""Meshes of what is in the way: files of a scenario, of a target's URDF, and vertices in messages.

What is refused of a robot's meshes (`test_mesh_limits.py`) is refused of theirs.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import Obstacle
from geometry_msgs.msg import Point
from quick_capture import quick_capture
from shape_msgs.msg import Mesh, MeshTriangle
from test_mesh_limits import BY_TIER, EVIL, OF_ALL_SIZES
from test_meshes import BOX, CORNERS, FACES, WRITERS, body_of, dae, loaded, sphere, stl
from test_target_urdf import URDF, scenario_with_urdf

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages.obstacles import MAX_TRIANGLES, solid_in
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.notes import notes_on
from ff_planner_ros.robot.collision.solids import (
    MAX_MESH_VERTICES,
    MeshFile,
    Solid,
    hull_of_vertices,
)
from ff_planner_ros.robot.urdf.convex_hull import MAX_VERTICES, once
from ff_planner_ros.robot.urdf.mesh_files import MAX_FILE, MAX_FILES
from ff_planner_ros.robot.urdf.payload import PAYLOAD, HeldShape, Payload, with_payload

NAME = "client"  # of the obstacle with the mesh
BUS = '<box size="1 0.8 0.6"/>'  # the target's solid that a mesh replaces


def of_obstacles(directory: Path, *files: str, scale: Any = None) -> Path:
    """Write a scenario whose obstacles have these meshes; they are beside it."""
    entries = [
        {
            "id": NAME + str(number or ""),
            "shape": {"mesh": {"file": file} | ({} if scale is None else {"scale": scale})},
            "position": [30.0 + 20.0 * number, 0.0, 0.0],
        }
        for number, file in enumerate(files)
    ]
    return quick_capture(directory, obstacles=entries)


def of_target(directory: Path, *files: str, scale: Any = None) -> Path:
    """Write one whose target has them, on its bus; they are beside the target's URDF."""
    scenario = scenario_with_urdf(directory)
    word = "" if scale is None else f' scale="{" ".join(map(str, scale))}"'
    meshes = "</geometry></collision><collision><geometry>".join(
        f'<mesh filename="../{file}"{word}/>' for file in files
    )
    urdf = directory / "client/client.urdf"
    urdf.write_text(URDF.replace(BUS, meshes), encoding="utf-8")
    return scenario


Write = Callable[..., Path]
IN_THE_WAY = pytest.mark.parametrize("written", [of_obstacles, of_target])
# Beginning and end of the field that a refusal names.
FIELDS = {
    of_obstacles: ("obstacles[0].shape.mesh", ".file"),
    of_target: ("target_body.urdf link 'bus'", "collision mesh"),
}


def solid_of(scenario: Path) -> Solid:
    """Return the mesh of a scenario."""
    return next(one.solid for one in load_scenario(scenario).obstacles if one.solid.kind == "mesh")


def require_told(refused: InvalidInput, written: Write, words: str) -> None:
    (fault,) = refused.faults
    begin, end = FIELDS[written]
    assert fault.field.startswith(begin), str(refused)
    assert fault.field.endswith(end), str(refused)
    assert words in str(fault), str(refused)
    assert fault.status is Status.OUT_OF_RANGE


@pytest.mark.law("FILE-02")
@pytest.mark.sampled  # the reader is that of a robot's meshes
@pytest.mark.parametrize("kind", EVIL)
@IN_THE_WAY
def test_a_mesh_that_harms_its_reader_is_told_alone_and_one_beside_it_is_read(
    written: Write, kind: str, tmp_path: Path
) -> None:
    content, words = EVIL[kind]
    (tmp_path / "evil.dae").write_bytes(content)
    (tmp_path / "good.stl").write_bytes(stl(BOX))
    scenario = written(tmp_path, "evil.dae", "good.stl")
    with pytest.raises(InvalidInput) as refused:
        load_scenario(scenario)
    require_told(refused.value, written, words)
    (tmp_path / "evil.dae").write_bytes(dae(BOX))
    meshes = [one for one in load_scenario(scenario).obstacles if one.solid.kind == "mesh"]
    assert [len(one.solid.corners) for one in meshes] == [8, 8]


@IN_THE_WAY
def test_a_file_that_is_too_large_is_refused_before_it_is_read(
    written: Write, tmp_path: Path
) -> None:
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(MAX_FILE + 1)
    with pytest.raises(InvalidInput) as refused:
        load_scenario(written(tmp_path, "large.stl"))
    require_told(refused.value, written, f"{MAX_FILE + 1} bytes, more than {MAX_FILE}")


def test_files_of_a_target_are_refused_that_are_too_large_together(tmp_path: Path) -> None:
    """Each is as large as one may be, and the last one is not looked into."""
    names = [f"part{number}.stl" for number in range(MAX_FILES // MAX_FILE + 1)]
    for name in names:
        with (tmp_path / name).open("wb") as file:
            file.truncate(MAX_FILE)
    with pytest.raises(InvalidInput) as refused:
        load_scenario(of_target(tmp_path, *names))
    words = f"all files together have more than {MAX_FILES} bytes"
    assert str(refused.value).count(words) == 1


@pytest.mark.sampled
@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("kind", BY_TIER)
@IN_THE_WAY
def test_every_mesh_of_the_documented_size_is_read(
    written: Write, kind: str, tmp_path: Path
) -> None:
    triangles = OF_ALL_SIZES[kind]()
    (tmp_path / "large.stl").write_bytes(stl(triangles))
    solid = solid_of(written(tmp_path, "large.stl"))
    require_around(solid, triangles.reshape(-1, 3))


def require_around(solid: Solid, points: Array) -> None:
    """A solid holds its points, and has few corners, hardly beyond them."""
    assert 4 <= len(solid.corners) <= MAX_VERTICES
    ways = np.random.default_rng(1).normal(size=(50, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    beyond = solid.furthest(ways) - np.array([(points @ way).max() for way in ways])
    assert beyond.min() > -1e-6
    assert beyond.max() < 0.05 * np.ptp(points, axis=0).max()


@IN_THE_WAY
def test_the_scale_of_a_mesh_counts_along_each_axis(written: Write, tmp_path: Path) -> None:
    (tmp_path / "box.stl").write_bytes(stl(BOX))
    for scale in ([1.0, 1.0, 1.0], [2.0, -1.0, 0.5], [-0.1, 30.0, -7.0]):
        found = solid_of(written(tmp_path, "box.stl", scale=scale)).corners
        wanted = np.unique(CORNERS.astype("<f4") * scale, axis=0)
        np.testing.assert_allclose(np.unique(found, axis=0), wanted, atol=1e-12)
    plain = solid_of(written(tmp_path, "box.stl")).corners
    np.testing.assert_array_equal(
        np.unique(plain, axis=0), np.unique(CORNERS.astype("<f4"), axis=0)
    )


@pytest.mark.parametrize(
    "scale", [[1.0, 0.0, 1.0], [1.0, 1.0, 10001.0], [1.0, float("nan"), 1.0], [1.0, 1.0]]
)
@IN_THE_WAY
def test_a_scale_that_is_none_is_refused_by_its_place(
    written: Write, scale: list[float], tmp_path: Path
) -> None:
    (tmp_path / "box.stl").write_bytes(stl(BOX))
    with pytest.raises(InvalidInput) as refused:
        load_scenario(written(tmp_path, "box.stl", scale=scale))
    (fault,) = refused.value.faults
    assert fault.field.startswith(FIELDS[written][0])
    assert "scale" in str(fault)


def box(low: list[float], high: list[float]) -> Array:
    """Return the triangles of a box, each with its normal outwards."""
    middle, size = CORNERS.mean(axis=0), np.ptp(CORNERS, axis=0)
    corners = (CORNERS - middle) / size + 0.5
    placed: Array = low + corners * (np.array(high) - low)
    return np.array([placed[list(face)] for face in FACES])


@pytest.mark.parametrize("kind", WRITERS)
@IN_THE_WAY
def test_the_hull_of_an_l_of_two_boxes_has_ten_corners(
    written: Write, kind: str, tmp_path: Path
) -> None:
    """Three cubes; the hull's notch is cut off along a diagonal."""
    corner = np.concatenate([box([0, 0, 0], [2, 1, 1]), box([0, 1, 0], [1, 2, 1])])
    (tmp_path / f"l.{kind}").write_bytes(WRITERS[kind](corner))
    for scale in ([1.0, 1.0, 1.0], [0.5, -3.0, 0.01]):
        solid = solid_of(written(tmp_path, f"l.{kind}", scale=scale))
        assert len(solid.corners) == 10, scale


def test_the_same_file_is_the_same_solid_with_the_same_note_wherever_it_is_named(
    tmp_path: Path,
) -> None:
    """On a robot's link, on a payload, as an obstacle, and on a target."""
    (tmp_path / "ball.stl").write_bytes(stl(sphere(60)))
    robot = loaded(tmp_path, '<mesh filename="ball.stl"/>')
    held = HeldShape("shape", MeshFile("ball.stl", (1.0, 1.0, 1.0)), np.zeros(3))
    payload = Payload("link_4", 1.0, 0.01 * np.eye(3), shapes=(held,)).loaded(tmp_path)
    carrying = with_payload(robot, payload)
    wanted = once(body_of(robot).solid.points())
    np.testing.assert_array_equal(once(body_of(carrying, PAYLOAD).solid.points()), wanted)
    (note,) = [one for one in robot.notes if "simplified" in one]
    assert note.startswith("mesh ball.stl: its hull is simplified from 3")
    assert carrying.notes.count(note) == 1
    for written in (of_obstacles, of_target):
        problem = load_scenario(written(tmp_path, "ball.stl"))
        (solid,) = [one.solid for one in problem.obstacles if one.solid.kind == "mesh"]
        np.testing.assert_array_equal(once(solid.corners), wanted)
        told = [one for one in notes_on(problem, load_parameters().planner) if "simplified" in one]
        assert [one.removeprefix("target_body.urdf: ") for one in told] == [note]


def ball(count: int) -> Array:
    points = np.random.default_rng(2).normal(size=(count, 3))
    return np.array(points / np.linalg.norm(points, axis=1)[:, None])


def pyramid(count: int) -> Array:
    """Points of which all but one are in one plane."""
    turn = np.linspace(0.0, 2.0 * np.pi, count - 1, endpoint=False)
    base = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count - 1)])
    return np.vstack([base, [0.0, 0.0, 0.5]])


def bowl(count: int) -> Array:
    x, y = np.random.default_rng(3).uniform(-1.0, 1.0, (2, count))
    return np.column_stack([x, y, x**2 + y**2])


CLOUDS = {one.__name__: one for one in (ball, pyramid, bowl)}
MAX_SECONDS = 10
MOST_MEMORY = 500_000_000  # [bytes] more than before; of the ball: 90 million
IN_LIMITS = f"""
import resource, sys
from pathlib import Path
from test_mesh_limits_of_scenarios import CLOUDS, message_of, require_around
from ff_planner_ros.messages.obstacles import solid_in
points = CLOUDS[sys.argv[1]](int(sys.argv[2]))
message = message_of(points)
used = resource.getrusage(resource.RUSAGE_SELF)
seconds = int(used.ru_utime + used.ru_stime) + {MAX_SECONDS}
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + {MOST_MEMORY}, held + {MOST_MEMORY}))
require_around(solid_in(message, "scene.bodies[0]"), points)
"""


def message_of(points: Array, triangles: int = 0) -> Obstacle:
    vertices = [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
    faces = [MeshTriangle(vertex_indices=[0, 1, 2]) for _ in range(triangles)]
    return Obstacle(id=NAME, mesh=[Mesh(vertices=vertices, triangles=faces)])


@pytest.mark.sampled
@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("cloud", CLOUDS)
def test_a_message_with_all_vertices_that_it_may_have_is_hulled_within_a_meshs_limits(
    cloud: str,
) -> None:
    """The system ends the process that takes more time, and gives it no more memory."""
    test = Path(__file__).parent
    program = [sys.executable, "-c", IN_LIMITS, cloud, str(MAX_MESH_VERTICES)]
    ended = subprocess.run(program, cwd=test, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.law("FILE-02")
def test_a_message_with_a_vertex_or_a_triangle_more_is_refused_by_its_field() -> None:
    place = "scene.bodies[0]"
    many = message_of(np.zeros((MAX_MESH_VERTICES + 1, 3)))
    faces = message_of(ball(4), MAX_TRIANGLES + 1)
    for message, field, most in (
        (many, "vertices", MAX_MESH_VERTICES),
        (faces, "triangles", MAX_TRIANGLES),
    ):
        with pytest.raises(InvalidInput) as refused:
            solid_in(message, place)
        error = refused.value
        assert (error.status, error.field) == (Status.OUT_OF_RANGE, f"{place}.mesh.{field}")
        assert f"{most + 1} entries" in str(error)
        assert f"{most} at most" in str(error)
    with pytest.raises(InvalidInput, match=f"{MAX_MESH_VERTICES} at most") as refused:
        hull_of_vertices("shape.mesh.vertices", np.zeros((MAX_MESH_VERTICES + 1, 3)))
    assert refused.value.field == "shape.mesh.vertices"
