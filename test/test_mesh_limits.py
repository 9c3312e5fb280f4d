"""Meshes that crash their reader, or take all time or memory, are refused and harm nobody."""

import re
import string
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pytest
import yaml
from robots import LEMUR_SCENARIO, LEMUR_URDF
from test_meshes import BOX, ENDS, body_of, dae, loaded, sphere, stl, urdf_with

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.collision.outermost import Boxes
from ff_planner_ros.robot.model import load_robot
from ff_planner_ros.robot.urdf import meshes
from ff_planner_ros.robot.urdf.convex_hull import MAX_VERTICES
from ff_planner_ros.robot.urdf.mesh_files import MAX_FILE, MAX_NODES

RNG = np.random.default_rng(8)
NODE, NODES = "<node><translate>", "<library_visual_scenes>"


def changed(*changes: tuple[str, str]) -> bytes:
    """A Collada file of a box with other words in it."""
    text = dae(BOX).decode()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text.encode()


def with_nodes(nodes: str, first: str) -> bytes:
    """One whose scene holds nodes that hold others."""
    library = f"<library_nodes>{nodes}</library_nodes>{NODES}"
    held = f'<node><instance_node url="#{first}"/><translate>'
    return changed((NODES, library), (NODE, held))


def doubled(times: int) -> str:
    """Nodes that hold the one before them twice each."""
    held = ['<instance_geometry url="#g"/>']
    held += [2 * f'<instance_node url="#n{number}"/>' for number in range(times)]
    return "".join(f'<node id="n{number}">{some}</node>' for number, some in enumerate(held))


def entities(times: int) -> str:
    """A document type whose entities hold the one before them ten times each."""
    names = string.ascii_lowercase[: times + 1]
    held = [f'<!ENTITY a "{10 * "1 "}">']
    held += [f'<!ENTITY {b} "{10 * f"&{a};"}">' for a, b in pairwise(names)]
    return f'<?xml version="1.0"?><!DOCTYPE a [{"".join(held)}]>'


EVIL = {
    "a node holds itself": (
        with_nodes('<node id="n"><instance_node url="#n"/></node>', "n"),
        f"it has more than {MAX_NODES} nodes in its scene",
    ),
    "nodes that double 26 times": (
        with_nodes(doubled(26), "n26"),
        f"it has more than {MAX_NODES} nodes in its scene",
    ),
    "an array of four billion": (
        changed(('count="108"', 'count="4000000000"')),
        "it cannot be read: an array has fewer or more numbers than it says",
    ),
    "entities that hold others": (
        changed(('<?xml version="1.0"?>', entities(12)), ("1 2 3", "&m;")),
        "it has a <!DOCTYPE>",
    ),
}


@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("kind", EVIL)
def test_a_mesh_that_harms_its_reader_is_refused_in_words_and_the_next_one_is_read(
    kind: str, tmp_path: Path
) -> None:
    content, words = EVIL[kind]
    (tmp_path / "evil.dae").write_bytes(content)
    (tmp_path / "good.stl").write_bytes(stl(BOX))
    good = '<collision><geometry><mesh filename="good.stl"/></geometry></collision>'
    text = urdf_with('<mesh filename="evil.dae"/>').replace(
        '<link name="link_3">', f'<link name="link_3">{good}'
    )
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(InvalidInput, match=f"evil.dae: {re.escape(words)}") as refused:
        load_robot(tmp_path / "arm.urdf", *ENDS)
    assert "link_3" not in str(refused.value)
    (tmp_path / "evil.dae").write_bytes(dae(BOX))
    assert body_of(load_robot(tmp_path / "arm.urdf", *ENDS), "link_3").solid.num_points == 8


def test_nodes_in_each_other_are_read_however_deep(tmp_path: Path) -> None:
    deep = changed((NODE, 10_000 * "<node>" + "<translate>"), ("</node>", 10_000 * "</node>"))
    (tmp_path / "deep.dae").write_bytes(deep)
    assert body_of(loaded(tmp_path, '<mesh filename="deep.dae"/>')).solid.num_points == 8


def fan(count: int) -> Array:
    """Triangles of a pyramid whose base has so many corners."""
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    base = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1)
    top = np.broadcast_to([0.0, 0.0, 0.5], base.shape)
    return np.stack([base, np.roll(base, -1, axis=0), top], axis=1)


def soup(count: int) -> Array:
    """Triangles on a ball, none beside another: three million corners of a million."""
    points = RNG.normal(size=(count, 3, 3))
    return np.array(points / np.linalg.norm(points, axis=2, keepdims=True))


LARGE = {
    "300,000 triangles on a ball": lambda: sphere(389)[:300_000],
    "a face with 1e5 corners": lambda: fan(100_000),
}
LARGEST = {
    "a million triangles on a ball": lambda: sphere(708)[:999_999],
    "a face with a million corners": lambda: fan(999_999),
}
SLOWEST = {"a million triangles apart": lambda: soup(999_999)}
OF_ALL_SIZES = LARGE | LARGEST | SLOWEST
BY_TIER = [
    *LARGE,
    *(pytest.param(name, marks=pytest.mark.ci) for name in LARGEST),
    *(pytest.param(name, marks=pytest.mark.nightly) for name in SLOWEST),
]


@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("kind", BY_TIER)
def test_every_mesh_of_the_documented_size_is_read(kind: str, tmp_path: Path) -> None:
    content = stl(OF_ALL_SIZES[kind]())
    assert len(content) <= MAX_FILE
    (tmp_path / "large.stl").write_bytes(content)
    robot = loaded(tmp_path, '<mesh filename="large.stl"/>')
    assert 0 < body_of(robot).solid.num_points <= MAX_VERTICES


def scenario_among_meshes(directory: Path, count: int) -> Path:
    """Write the paper's capture with meshes of equal files far away, and none of its spheres."""
    document = yaml.safe_load(LEMUR_SCENARIO.read_text("utf-8"))
    document["robot"]["urdf"] = str(LEMUR_URDF)
    document["obstacles"] = []
    for number in range(count):
        (directory / f"{number}.stl").write_bytes(stl(BOX))
        shape = {"mesh": {"file": f"{number}.stl"}}
        document["obstacles"].append(
            {"id": f"m{number}", "shape": shape, "position": [9.0, 3.0 * number, 0.0]}
        )
    path = directory / "capture.yaml"
    path.write_text(yaml.safe_dump(document), "utf-8")
    return path


def test_files_of_obstacles_count_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As those of a robot do, and as docs/reference/files.md says."""
    size = len(stl(BOX))
    monkeypatch.setattr(meshes, "MAX_FILES", 3 * size)
    assert len(load_scenario(scenario_among_meshes(tmp_path, 3)).obstacles) == 3
    words = rf"obstacles\[3\]\S* .*all files together have more than {3 * size} bytes"
    with pytest.raises(InvalidInput, match=words):
        load_scenario(scenario_among_meshes(tmp_path, 4))


def test_a_binary_stl_is_read_as_assimp_reads_it(tmp_path: Path) -> None:
    given = RNG.normal(size=(50, 3, 3))
    given[::7, 1] = given[::7, 0]  # no triangles: they are passed over
    (tmp_path / "ours.stl").write_bytes(stl(given))
    lines = ["solid a"]
    for triangle in given.astype("<f4").tolist():
        corners = "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in triangle)
        lines.append(f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet")
    (tmp_path / "theirs.stl").write_text("\n".join([*lines, "endsolid a\n"]))
    solids = [
        body_of(loaded(tmp_path, f'<mesh filename="{name}.stl"/>')).solid
        for name in ("ours", "theirs")
    ]
    assert isinstance(solids[0], coal.Convex)
    assert solids[0] == solids[1]


def test_boxes_of_points_say_what_looking_at_every_point_says() -> None:
    for count in (1, 7, 3000, 40_000):
        points = RNG.normal(size=(count, 3)) * [3.0, 1.0, 0.01]
        ways, boxes = RNG.normal(size=(40, 3)), Boxes(points)
        found = np.einsum("ij,ij->i", boxes.outermost(ways), ways)
        np.testing.assert_allclose(found, (points @ ways.T).max(axis=0), rtol=1e-12)
        planes = np.hstack([ways, -2.0 * np.ones((40, 1))])
        wanted = points[(points @ ways.T >= 2.0).any(axis=1)]
        outside = boxes.outside(planes, len(points))
        assert outside is not None
        np.testing.assert_array_equal(np.unique(outside, axis=0), np.unique(wanted, axis=0))
        if len(wanted):
            assert boxes.outside(planes, len(wanted) - 1) is None
