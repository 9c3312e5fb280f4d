"""A target body from a URDF: its shapes, and what it weighs, from a file or a message."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from test_tumbling import body_of

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.notes import notes_on, notes_on_files
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.ros.messages.from_messages import target_body_from_message
from ff_planner_ros.ros.messages.to_messages import target_body_message

FRAME = "inertial"
SETTINGS = load_parameters().planner
URDF = """
<robot name="client">
  <link name="bus">
    <inertial>
      <origin xyz="0.1 0 0" rpy="0.3 0 0"/>
      <mass value="100"/>
      <inertia ixx="10" iyy="12" izz="8" ixy="0.5" ixz="0" iyz="0"/>
    </inertial>
    <collision><geometry><box size="1 0.8 0.6"/></geometry></collision>
    <collision>
      <origin xyz="0 0 0.5" rpy="0 1.5 0"/>
      <geometry><cylinder radius="0.2" length="0.3"/></geometry>
    </collision>
  </link>
  <link name="panel">
    <inertial>
      <origin xyz="0 1 0"/>
      <mass value="20"/>
      <inertia ixx="6" iyy="1" izz="7" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision>
      <origin xyz="0 1 0"/><geometry><box size="0.5 2 0.02"/></geometry>
    </collision>
  </link>
  <link name="antenna">
    <collision><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <joint name="drive" type="revolute">
    <parent link="bus"/><child link="panel"/>
    <origin xyz="0 0.4 0" rpy="0 0.2 0"/><axis xyz="0 1 0"/>
    <limit lower="0.5" upper="1" velocity="1" effort="1"/>
  </joint>
  <joint name="mast" type="fixed">
    <parent link="panel"/><child link="antenna"/><origin xyz="0 2.2 0"/>
  </joint>
</robot>
"""


def body_alone() -> TargetBody:
    return replace(body_of(tumbling.problem("tumbling", 0)), obstacles=())


def _message(urdf: str, inertia: Array | None = None) -> Any:
    message = target_body_message(body_alone(), 0, FRAME)
    message.urdf = urdf
    if inertia is None:
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            setattr(message.inertia, name, 0.0)
    return message


def _read(urdf: str, inertia: Array | None = None) -> TargetBody:
    return target_body_from_message(_message(urdf, inertia), FRAME)


# The limit of the joint `drive` that is nearest to zero [rad].
DRIVE = 0.5


def _by_pinocchio(
    urdf: str, joints: Sequence[float] = (DRIVE,)
) -> tuple[pin.Model, pin.GeometryModel, pin.Inertia]:
    """Return model, solids and inertia with the joints so, as Pinocchio reads them."""
    model = pin.buildModelFromXML(urdf)
    solids = pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)
    data = model.createData()
    pin.forwardKinematics(model, data, np.array(joints))
    whole = model.inertias[0]
    for joint in range(1, model.njoints):
        whole = whole + data.oMi[joint].act(model.inertias[joint])
    return model, solids, whole


def test_shapes_and_inertia_are_as_pinocchio_reads_them_about_the_centre_of_mass() -> None:
    body = _read(URDF)
    model, solids, whole = _by_pinocchio(URDF)
    assert body.inertia == pytest.approx(whole.inertia, abs=1e-9)
    fixed = {one.id: one for one in body.obstacles}
    # Spheres come first, as in messages.
    assert list(fixed) == ["antenna", "bus", "bus#2", "panel"]
    data, placed = model.createData(), solids.createData()
    pin.updateGeometryPlacements(model, data, solids, placed, np.array([DRIVE]))
    in_file = [fixed[name] for name in ("bus", "bus#2", "panel", "antenna")]
    for one, found in zip(in_file, solids.geometryObjects, strict=True):
        place = placed.oMg[solids.getGeometryId(found.name)]
        assert one.position == pytest.approx(place.translation - whole.lever, abs=1e-12)
        if not one.is_sphere:
            turned = pin.Quaternion(one.quaternion_xyzw).toRotationMatrix()
            assert turned == pytest.approx(place.rotation, abs=1e-12)
    assert [(one.solid.kind, one.solid.sizes.tolist()) for one in in_file] == [
        *(("box", [1.0, 0.8, 0.6]), ("cylinder", [0.2, 0.3])),
        *(("box", [0.5, 2.0, 0.02]), ("sphere", [0.1])),
    ]


def test_an_inertia_beside_the_urdf_counts() -> None:
    wanted = body_alone().inertia
    assert (_read(URDF, wanted).inertia == wanted).all()


def test_other_obstacles_stay_beside_the_shapes() -> None:
    message = _message(URDF)
    body = body_of(tumbling.problem("tumbling", 0))
    message.obstacles = target_body_message(body, 0, FRAME).obstacles
    found = target_body_from_message(message, FRAME)
    assert len(found.obstacles) == len(body.obstacles) + 4 > 4
    assert sum(one.is_sphere for one in found.obstacles) == len(body.obstacles) + 1
    message.obstacles[0].id = "panel"
    with pytest.raises(InvalidInput, match="ids must be unique"):
        target_body_from_message(message, FRAME)


@pytest.mark.parametrize(
    ("old", "new", "field", "words"),
    [
        ("<robot", "<world", "target_body.urdf", "must be <robot>"),
        ('<box size="1 0.8 0.6"/>', '<box size="1 -0.8 0.6"/>', "target_body.urdf link 'bus'", ""),
        (
            '<box size="1 0.8 0.6"/>',
            '<mesh filename="/etc/passwd.stl"/>',
            "target_body.urdf link 'bus'",
            "not from a file, and may name no others",
        ),
        ('xyz="0 0.4 0"', 'xyz="0 nan 0"', "target_body.urdf joint 'drive'", "finite"),
        ('iyy="12"', 'iyy="120"', "target_body.urdf link 'bus' inertia", "sum of the others"),
        ('value="100"', 'value="-1"', "target_body.urdf link 'bus' mass", "negative"),
        ('<parent link="bus"/>', "<nothing/>", "target_body.urdf", ""),
        ('type="revolute"', 'type="floating"', "target_body.urdf joint 'drive'", "is floating: it"),
        ('type="revolute"', 'type="planar"', "target_body.urdf joint 'drive'", "is planar: it"),
        (
            '<axis xyz="0 1 0"/>',
            '<axis xyz="0 0 0"/>',
            "target_body.urdf joint 'drive' axis",
            "direction",
        ),
        (
            '<axis xyz="0 1 0"/>',
            '<axis xyz="0 1 0"/><mimic joint="drive"/>',
            "target_body.urdf joint 'drive'",
            "in a ring of joints that mimic each other",
        ),
        ("<robot", '<!DOCTYPE a [<!ENTITY b "c">]><robot', "target_body.urdf", "DOCTYPE"),
    ],
)
def test_a_bad_urdf_is_told_by_its_place(old: str, new: str, field: str, words: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        _read(URDF.strip().replace(old, new, 1))
    error = refused.value
    assert error.field.startswith(field), str(error)
    assert error.status is Status.OUT_OF_RANGE
    assert words in str(error)


def test_a_urdf_without_mass_has_no_centre() -> None:
    light = URDF.replace('<mass value="100"/>', '<mass value="0"/>').replace(
        '<mass value="20"/>', '<mass value="0"/>'
    )
    for inertia in ("10", "12", "8", "0.5", "6", "1", "7"):
        light = light.replace(f'="{inertia}" i', '="0" i').replace(f'izz="{inertia}"', 'izz="0"')
    with pytest.raises(InvalidInput, match="positions are from its centre"):
        _read(light, body_alone().inertia)


def scenario_with_urdf(directory: Path, **more: Any) -> Path:
    """Write a capture whose body has a URDF beside it."""
    task = PlanningTask(tumbling.problem("tumbling", 0), SETTINGS)
    path = directory / "capture.yaml"
    write_scenario(task, path)
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    del document["target_body"]["inertia"]
    document["target_body"]["obstacles"] = []
    document["target_body"]["grasp"]["position"] = [0.0, 0.0, -2.0]
    document["target_body"] |= {"urdf": "client/client.urdf"} | more
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    (directory / "client").mkdir(exist_ok=True)
    (directory / "client/client.urdf").write_text(URDF, encoding="utf-8")
    return path


def tetrahedron(path: Path) -> None:
    """Write an STL of which the hull has more than it: a corner is cut into it."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.1, 0.1, 0.1)], "<f4")
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)]
    rows = [np.concatenate([np.zeros((1, 3), "<f4"), points[list(face)]]) for face in faces]
    content = b"".join(row.tobytes() + b"\0\0" for row in rows)
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + content)


def test_a_scenarios_body_has_the_shapes_of_its_urdf_and_is_written_with_them(
    tmp_path: Path,
) -> None:
    scenario = scenario_with_urdf(tmp_path)
    body = body_of(load_scenario(scenario))
    assert [one.id for one in body.obstacles] == ["antenna", "bus", "bus#2", "panel"]
    assert body.inertia == pytest.approx(_by_pinocchio(URDF)[2].inertia, abs=1e-9)
    task = load_task(scenario, Defaults(SETTINGS))
    (tmp_path / "again").mkdir()
    write_scenario(task, tmp_path / "again" / "again.yaml")
    text = (tmp_path / "again" / "again.yaml").read_text(encoding="utf-8")
    written = yaml.safe_load(text)["target_body"]
    assert "urdf" not in written
    assert [one["id"] for one in written["obstacles"]] == [one.id for one in body.obstacles]
    assert list(written["obstacles"][1]["shape"]) == ["box"]
    again = load_task(tmp_path / "again" / "again.yaml", Defaults(SETTINGS))
    assert again.digest == task.digest


def test_a_scenarios_urdf_may_name_meshes_beside_it(tmp_path: Path) -> None:
    scenario = scenario_with_urdf(tmp_path)
    urdf = tmp_path / "client/client.urdf"
    mesh = '<mesh filename="bus.stl" scale="0.5 -0.7 0.9"/>'
    urdf.write_text(URDF.replace('<box size="1 0.8 0.6"/>', mesh), encoding="utf-8")
    tetrahedron(tmp_path / "client/bus.stl")
    body = body_of(load_scenario(scenario))
    (bus,) = [one for one in body.obstacles if one.id == "bus"]
    assert not bus.is_sphere
    assert isinstance(bus.shape, Solid)
    scaled = np.array([(0, 0, 0), (0.5, 0, 0), (0, -0.7, 0), (0, 0, 0.9)])
    for corner in scaled:
        assert np.linalg.norm(bus.shape.corners - corner, axis=1).min() < 1e-7
    # What is written holds the hull itself, and is the same to the last bit.
    task = load_task(scenario, Defaults(SETTINGS))
    write_scenario(task, tmp_path / "again.yaml")
    message = target_body_message(body, 0, FRAME)
    read = target_body_from_message(message, FRAME)
    (again,) = [one for one in read.obstacles if one.id == "bus"]
    assert not again.is_sphere
    assert isinstance(again.shape, Solid)
    assert (again.shape.corners == bus.shape.corners).all()


@pytest.mark.parametrize(
    ("more", "field", "words"),
    [
        ({"urdf": "nowhere.urdf"}, "target_body.urdf", "no file"),
        ({"urdf": ""}, "target_body.urdf", ""),
        ({"urdf": "client"}, "target_body.urdf", ""),
        ({"velocity": [0, 0, 0]}, "target_body.velocity", "unknown"),
        ({"grasp": {}}, "target_body.grasp.position", "missing"),
        ({"inertia": {"ixx": 1.0}}, "target_body.inertia", ""),
    ],
)
def test_a_scenarios_urdf_that_cannot_be_read_is_told(
    tmp_path: Path, more: dict[str, Any], field: str, words: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        load_scenario(scenario_with_urdf(tmp_path, **more))
    assert any(one.field.startswith(field) for one in refused.value.faults), str(refused.value)
    assert words in str(refused.value)


FLAP = """
  <link name="flap">
    <inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.4"/><geometry><box size="0.3 0.02 0.8"/></geometry></collision>
  </link>
  <joint name="hinge" type="continuous">
    <parent link="panel"/><child link="flap"/><origin xyz="0 2 0"/><axis xyz="2 0 0"/>
    <mimic joint="drive" multiplier="-2" offset="0.3"/>
  </joint>
</robot>
"""


@pytest.mark.parametrize(
    ("given", "drive"), [({}, DRIVE), ({"drive": 0.9}, 0.9), ({"drive": 0.9, "hinge": -1.5}, 0.9)]
)
def test_the_joints_of_a_target_are_where_the_scenario_says_or_as_near_to_zero_as_they_can(
    tmp_path: Path, given: dict[str, float], drive: float
) -> None:
    scenario = scenario_with_urdf(tmp_path, locked_joints=given)
    urdf = URDF.replace("</robot>", FLAP)
    (tmp_path / "client/client.urdf").write_text(urdf, encoding="utf-8")
    task = load_task(scenario, Defaults(SETTINGS))
    body, hinge = body_of(task.problem), 0.3 - 2.0 * drive
    # Pinocchio knows no mimic joints: its joint `hinge`, a continuous one, is cosine and sine.
    joints = drive, np.cos(hinge), np.sin(hinge)
    model, solids, whole = _by_pinocchio(urdf, joints)
    assert body.inertia == pytest.approx(whole.inertia, abs=1e-9)
    data, placed = model.createData(), solids.createData()
    pin.updateGeometryPlacements(model, data, solids, placed, np.array(joints))
    (flap,) = [one for one in body.obstacles if one.id == "flap"]
    place = placed.oMg[solids.getGeometryId("flap_0")]
    assert not flap.is_sphere
    assert flap.position == pytest.approx(place.translation - whole.lever, abs=1e-12)
    turned = pin.Quaternion(flap.quaternion_xyzw).toRotationMatrix()
    assert turned == pytest.approx(place.rotation, abs=1e-12)
    told = (
        f"target_body.urdf: its joints are locked: drive at {drive:g} rad, hinge at {hinge:g} rad"
    )
    assert notes_on_files(task) == notes_on(task.problem, task.settings) == (told,)
    # What is written has the shapes where the joints put them, and needs no joints.
    write_scenario(task, tmp_path / "again.yaml")
    assert load_task(tmp_path / "again.yaml", Defaults(SETTINGS)).digest == task.digest


def test_a_check_prints_notes_on_a_target(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(scenario_with_urdf(tmp_path))]) == 0
    told = "note: target_body.urdf: its joints are locked: drive at 0.5 rad\n"
    assert capsys.readouterr().err == f"ff-planner: {told}"


def test_a_message_and_a_scenario_have_the_joints_of_a_target_at_the_same_positions() -> None:
    note = "target_body.urdf: its joints are locked: drive at 0.5 rad"
    assert _read(URDF).notes == (note,)
    alone = _read(URDF.replace("<limit", '<mimic joint="motor"/><limit'))
    other = "target_body.urdf: joints that mimic one that is not there: drive mimics motor"
    assert alone.notes == (note, other)


def test_what_of_a_target_is_not_read_and_cannot_matter_is_noted() -> None:
    unread = _read(URDF.replace("</robot>", "<catalogue/></robot>"))
    assert unread.notes[0] == "target_body.urdf: not read: <catalogue> in <robot>"
    assert unread.notes[1:] == _read(URDF).notes


def test_an_inertia_of_a_target_in_another_unit_is_noted() -> None:
    """In g mm2: of a bus of 100 kg and 1 m."""
    told = 'ixx="10" iyy="12" izz="8" ixy="0.5"'
    note = _read(URDF.replace(told, 'ixx="10e9" iyy="12e9" izz="8e9" ixy="0.5e9"')).notes[-1]
    radius = np.sqrt(1e9 * np.linalg.eigvalsh([[10, 0.5, 0], [0.5, 12, 0], [0, 0, 8]])[2] / 100.0)
    told = f"link 'bus' has a radius of gyration sqrt(I/m) of {radius:.4g} m, "
    assert note.startswith(f"target_body.urdf: {told}")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"dirve": 0.5}, " 'dirve' is unknown: it must be one of the joints that move: drive"),
        ({"mast": 0.5}, " 'mast' is unknown: it must be one of the joints that move: drive"),
        ({"drive": float("nan")}, ".drive is nan: it must be finite"),
        ({"drive": 1e13}, " 'drive' is 10000000000000.0: its size must be at most 1e+12"),
        ({"drive": "far"}, ".drive is 'far': it must be a number, such as 1.0e-3"),
        ([0.5], " is [0.5]: it must hold a position for each name of a joint"),
    ],
)
def test_joints_of_a_target_that_cannot_be_locked_are_refused(
    tmp_path: Path, given: Any, words: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        load_scenario(scenario_with_urdf(tmp_path, locked_joints=given))
    assert str(refused.value) == f"target_body.locked_joints{words}"


def test_locked_joints_of_a_target_without_a_urdf_are_refused(tmp_path: Path) -> None:
    scenario = scenario_with_urdf(tmp_path, locked_joints={"drive": 0.5})
    document = yaml.safe_load(scenario.read_text(encoding="utf-8"))
    del document["target_body"]["urdf"]
    document["target_body"]["inertia"] = dict.fromkeys(("ixx", "iyy", "izz"), 1.0)
    document["target_body"]["inertia"] |= dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
    scenario.write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"target_body\.locked_joints is given: without a urdf"):
        load_scenario(scenario)


def test_without_a_urdf_the_inertia_must_be_there(tmp_path: Path) -> None:
    scenario = scenario_with_urdf(tmp_path)
    document = yaml.safe_load(scenario.read_text(encoding="utf-8"))
    del document["target_body"]["urdf"]
    scenario.write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"target_body\.inertia is missing"):
        load_scenario(scenario)
