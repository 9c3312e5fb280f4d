"""The demo of shapes with its client in a URDF or SDF: the plan of the scenario that has it inline.

The file has the same bodies by the same names, from another origin: half of the links are where
their joints are, and the solids of the others are moved in their links.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yaml
from recorded_requests import only_request
from robots import CONFIG, LEMUR_URDF
from test_meshes import BOX, stl
from test_tumbling import body_of

from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify

DEFAULTS = Defaults(load_parameters().planner)
GRASPED = "link_7/ring_0"
MASS = 80.0  # [kg]
CENTER = np.array([0.125, -0.25, 0.5])  # of mass, in the root link [m]
ROOT = "bus"
ROUNDING = 1e-6  # of plans, in SI units; poses of bodies agree to 1e-12
CUBE = "cube.stl"  # whose edges are as in `BOX`


class Part(NamedTuple):
    """A body of the client, as the scenario has it."""

    name: str
    kind: str
    sizes: dict[str, str]
    position: Array  # from the root link [m]
    quaternion: Array  # of unit length


def _words(numbers: Any) -> str:
    return " ".join(repr(float(one)) for one in np.ravel(numbers))


def _parts(body: dict[str, Any]) -> list[Part]:
    found = list[Part]()
    for one in body["obstacles"]:
        ((kind, sizes),) = one["shape"].items()
        turn = np.array(one.get("quaternion_xyzw", [0.0, 0.0, 0.0, 1.0]))
        told = {key: value if key == "file" else _words(value) for key, value in sizes.items()}
        place = np.array(one["position"]) + CENTER
        found.append(Part(one["id"], kind, told, place, turn / np.linalg.norm(turn)))
    return found


def urdf(body: dict[str, Any]) -> str:
    """Write a target body of a scenario as a URDF."""
    inertia = " ".join(f'{key}="{value!r}"' for key, value in body["inertia"].items())
    links, joints = "", ""
    for number, (name, kind, sizes, position, quaternion) in enumerate(_parts(body)):
        rpy = pin.rpy.matrixToRpy(pin.Quaternion(quaternion).toRotationMatrix())
        in_joint = bool(number % 2)
        place, none = f'<origin xyz="{_words(position)}" rpy="{_words(rpy)}"/>', "<origin/>"
        given = {"filename" if key == "file" else key: value for key, value in sizes.items()}
        shape = " ".join(f'{key}="{value}"' for key, value in given.items())
        weight = ""
        if name == ROOT:
            weight = f'<inertial><origin xyz="{_words(CENTER)}"/><mass value="{MASS}"/>'
            weight += f"<inertia {inertia}/></inertial>"
        else:
            joints += f'<joint name="to_{name}" type="fixed"><parent link="{ROOT}"/>'
            joints += f'<child link="{name}"/>{place if in_joint else none}</joint>'
        links += f'<link name="{name}">{weight}<collision>{none if in_joint else place}'
        links += f"<geometry><{kind} {shape}/></geometry></collision></link>"
    return f'<robot name="client">{links}{joints}</robot>'


def sdf(body: dict[str, Any]) -> str:
    """Write a target body of a scenario as an SDF."""
    light = "<mass>0</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia>"
    inertia = "".join(f"<{key}>{value!r}</{key}>" for key, value in body["inertia"].items())
    heavy = f"<pose>{_words(CENTER)} 0 0 0</pose><mass>{MASS}</mass><inertia>{inertia}</inertia>"
    links, joints = "", ""
    for number, (name, kind, sizes, position, quaternion) in enumerate(_parts(body)):
        in_link = bool(number % 2)
        pose = f'rotation_format="quat_xyzw">{_words(position)} {_words(quaternion)}</pose>'
        given = {"uri" if key == "file" else key: value for key, value in sizes.items()}
        shape = "".join(f"<{key}>{value}</{key}>" for key, value in given.items())
        if name != ROOT:
            joints += f'<joint name="to_{name}" type="fixed">'
            joints += f"<parent>{ROOT}</parent><child>{name}</child></joint>"
        links += f'<link name="{name}">{f"<pose {pose}" if in_link else ""}'
        links += f"<inertial>{heavy if name == ROOT else light}</inertial>"
        links += f'<collision name="c">{"" if in_link else f"<pose {pose}"}'
        links += f"<geometry><{kind}>{shape}</{kind}></geometry></collision></link>"
    return f'<sdf version="1.9"><model name="client">{links}{joints}</model></sdf>'


WRITTEN: dict[str, Callable[[dict[str, Any]], str]] = {"urdf": urdf, "sdf": sdf}


def _with_meshes(body: dict[str, Any]) -> None:
    """Write each box of a target body as a mesh that is scaled."""
    edges = np.ptp(BOX.reshape(-1, 3), axis=0)
    for one in body["obstacles"]:
        if "box" in one["shape"]:
            scale = (np.array(one["shape"]["box"]["size"]) / edges).tolist()
            one["shape"] = {"mesh": {"file": CUBE, "scale": scale}}


def scenario(
    directory: Path, format_: str = "", meshes: bool = False, allowed: str = GRASPED
) -> Path:
    """Write the scenario with its client inline, or in a file of a format beside it.

    Args:
        allowed: The pair that may touch at the goal.
    """
    text = (CONFIG / "scenarios" / "panel_capture.yaml").read_text("utf-8")
    document = yaml.safe_load(text)
    document["robot"]["urdf"] = str(LEMUR_URDF)
    document["allowed_collisions"] = {"pairs": [allowed]}
    body = document["target_body"]
    if meshes:
        (directory / CUBE).write_bytes(stl(BOX))
        _with_meshes(body)
    if format_:
        (directory / f"client.{format_}").write_text(WRITTEN[format_](body), "utf-8")
        del body["inertia"], body["obstacles"]
        body["urdf"] = f"client.{format_}"
    path = directory / "capture.yaml"
    path.write_text(yaml.safe_dump(document), "utf-8")
    return path


class Planned(NamedTuple):
    """A scenario's task and plan."""

    task: PlanningTask
    plan: Plan


def planned(path: Path) -> Planned:
    task = load_task(path, DEFAULTS)
    return Planned(task, perform(task))


@pytest.fixture(scope="module")
def inline(tmp_path_factory: pytest.TempPathFactory) -> Callable[[bool], Planned]:
    """Plan the scenario that has its client inline: with boxes, or with meshes of the same size."""

    @cache
    def made(meshes: bool) -> Planned:
        return planned(scenario(tmp_path_factory.mktemp("inline"), meshes=meshes))

    return made


FILES = pytest.mark.parametrize(
    ("format_", "meshes"),
    [
        ("urdf", False),
        ("sdf", False),
        pytest.param("urdf", True, marks=pytest.mark.ci),
        pytest.param("sdf", True, marks=pytest.mark.ci),
    ],
)


@FILES
def test_a_client_in_a_file_is_captured_by_the_plan_for_the_same_client_inline(
    format_: str, meshes: bool, inline: Callable[[bool], Planned], tmp_path: Path
) -> None:
    wanted = inline(meshes)
    task, plan = planned(scenario(tmp_path, format_, meshes))
    body, other = body_of(task.problem), body_of(wanted.task.problem)
    assert body.inertia == pytest.approx(other.inertia, abs=1e-12)
    for found, expected in zip(body.obstacles, other.obstacles, strict=True):
        assert not found.is_sphere
        assert not expected.is_sphere
        assert isinstance(found.shape, Solid)
        assert isinstance(expected.shape, Solid)
        assert (found.id, found.shape.words) == (expected.id, expected.shape.words)
        assert found.position == pytest.approx(expected.position, abs=1e-12)
        turns = [pin.Quaternion(one.quaternion_xyzw).matrix() for one in (found, expected)]
        assert turns[0] == pytest.approx(turns[1], abs=1e-12)
    # The search follows the rounding of these poses, which is all that differs.
    require_plan(plan, wanted.plan, ROUNDING)


@FILES
def test_its_plan_is_that_of_the_scenario_that_is_written_inline_from_it_to_the_last_bit(
    format_: str, meshes: bool, tmp_path: Path
) -> None:
    task, plan = planned(scenario(tmp_path, format_, meshes))
    write_scenario(task, tmp_path / "written.yaml")
    assert "urdf" not in yaml.safe_load((tmp_path / "written.yaml").read_text())["target_body"]
    again = planned(tmp_path / "written.yaml")
    assert again.task.digest == task.digest
    require_plan(again.plan, plan, 0.0)


def require_plan(plan: Plan, expected: Plan, tolerance: float) -> None:
    for item in fields(plan.trajectory):
        array, other = (getattr(one.trajectory, item.name) for one in (plan, expected))
        np.testing.assert_allclose(array, other, rtol=0.0, atol=tolerance, err_msg=item.name)
    found, wanted = (one.metrics.min_clearance for one in (plan, expected))
    assert found == pytest.approx(wanted, rel=0.0, abs=tolerance)


@FILES
@pytest.mark.law("BAG-02")
def test_its_bag_alone_gives_the_same_plan_again(
    format_: str, meshes: bool, tmp_path: Path
) -> None:
    """Without the files, which are gone by then."""
    path = scenario(tmp_path, format_, meshes)
    task, plan = planned(path)
    record_answer(tmp_path / "bag", task, plan, 0.5)
    for file in (path, tmp_path / f"client.{format_}", *tmp_path.glob(CUBE)):
        file.unlink()
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().digest == task.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL


@pytest.mark.ci
@pytest.mark.sampled
@FILES
def test_nothing_but_what_it_grasps_is_touched_in_mujoco(
    format_: str, meshes: bool, tmp_path: Path
) -> None:
    task, plan = planned(scenario(tmp_path, format_, meshes))
    problem = task.problem
    scene = scene_of(problem)
    assert scene.allowed_collisions == (GRASPED,)
    found = verify(problem.robot, plan.trajectory, scene)
    assert found.passed
    assert found.contacts == ()
    assert found.pairs > 200
    forbidden = verify(problem.robot, plan.trajectory, replace(scene, allowed_collisions=()))
    assert {one.pair for one in forbidden.contacts} == {GRASPED}


@pytest.mark.ci
@pytest.mark.law("PLAN-22")
@pytest.mark.parametrize("format_", WRITTEN)
def test_the_command_verifies_a_scenario_whose_client_is_in_a_file(
    format_: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(scenario(tmp_path, format_))]) == 0
    shown = capsys.readouterr().out
    assert "contacts: none of" in shown
    assert "verdict: passed" in shown


@pytest.fixture
def one_link(tmp_path: Path) -> Callable[[str], Path]:
    """Write a scenario with an allowed pair whose client has the piece that is grasped as a shape.

    It is the second one of the link of the bus.
    """

    def written(allowed: str) -> Path:
        path = scenario(tmp_path, "urdf", allowed=allowed)
        client = ElementTree.parse(tmp_path / "client.urdf")
        robot = client.getroot()
        bus, ring, joint = (
            found
            for place in (f"link[@name='{ROOT}']", "link[@name='ring_0']", "*[@name='to_ring_0']")
            if (found := robot.find(place)) is not None
        )
        bus.extend(ring.findall("collision"))
        robot.remove(ring)
        robot.remove(joint)
        client.write(tmp_path / "client.urdf")
        return path

    return written


def test_of_two_shapes_of_one_link_the_second_alone_may_touch_by_its_own_name(
    one_link: Callable[[str], Path], inline: Callable[[bool], Planned]
) -> None:
    task, plan = planned(one_link(f"link_7/{ROOT}#2"))
    names = [one.id for one in body_of(task.problem).obstacles]
    assert names[:3] == [ROOT, f"{ROOT}#2", "yoke_left"]
    assert "ring_0" not in names
    # It is the same client.
    require_plan(plan, inline(False).plan, ROUNDING)


def test_the_name_of_the_link_is_that_of_its_first_shape_and_allows_no_other(
    one_link: Callable[[str], Path],
) -> None:
    with pytest.raises(NoPlanFound, match=f"name link_7/{ROOT}#2 in allowed_collisions") as refused:
        planned(one_link(f"link_7/{ROOT}"))
    assert refused.value.status is Status.COLLISION
    with pytest.raises(InvalidInput, match=r"^allowed_collisions\.pairs is") as unknown:
        planned(one_link(f"link_7/{ROOT}#3"))
    assert f"{ROOT}, {ROOT}#2, yoke_left" in str(unknown.value)


@pytest.mark.ci
def test_mujoco_has_a_contact_with_the_second_shape_alone(
    one_link: Callable[[str], Path],
) -> None:
    pair = f"link_7/{ROOT}#2"
    task, plan = planned(one_link(pair))
    robot, scene = task.problem.robot, scene_of(task.problem)
    assert verify(robot, plan.trajectory, scene).passed
    found = verify(robot, plan.trajectory, replace(scene, allowed_collisions=()))
    assert {one.pair for one in found.contacts} == {pair}
