"""What `ff-planner robot` says of a file: against numbers by hand and Pinocchio's own reader."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import random_robot
from numpy.typing import ArrayLike
from robots import LEMUR_URDF, random_urdf

from ff_planner_ros import cli
from ff_planner_ros.analysis.robot_page import robot_facts, robot_rows
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import robot_from_urdf_text

# The base link is turned by a quarter against the root; the arm's inertia against its link, too.
TURNED = """<robot name="turned">
<link name="bus"><inertial><mass value="10"/>
  <inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="deck"/>
<link name="arm"><inertial><origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/>
  <mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="finger"><inertial><mass value="0.5"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="stand" type="fixed"><parent link="bus"/><child link="deck"/>
  <origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint>
<joint name="turn" type="continuous"><parent link="deck"/><child link="arm"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 -2"/></joint>
<joint name="grip" type="prismatic"><parent link="arm"/><child link="finger"/>
  <origin xyz="1 0 0"/><axis xyz="1 0 0"/>
  <limit lower="0.25" upper="0.5" effort="1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="tool"/>
  <origin xyz="1 0 0.25"/></joint>
</robot>"""


def facts_of(urdf: str, base: str | None = None, tip: str | None = None) -> dict[str, Any]:
    return robot_facts(robot_from_urdf_text(urdf, base, tip))


def steiner(mass: float, inertia: Array, lever: ArrayLike) -> Array:
    """Inertia of a body about a point that is a lever away from its centre of mass."""
    x, y, z = np.asarray(lever)
    square = [
        [y * y + z * z, -x * y, -x * z],
        [-x * y, x * x + z * z, -y * z],
        [0, 0, x * x + y * y],
    ]
    square[2][:2] = [-x * z, -y * z]
    return inertia + mass * np.array(square)


def test_masses_centres_and_inertias_are_those_by_hand() -> None:
    found = facts_of(TURNED, "deck", "tool")
    # Seen from the deck, which is 1 m from the bus along x and turned by a quarter about z.
    bus, arm, finger = [0.0, 1.0, 0.0], [0.5, 0.0, 0.5], [1.25, 0.0, 0.5]
    assert found["base"]["links"] == ["bus", "deck"]
    assert found["base"]["mass"] == 10.0
    np.testing.assert_allclose(found["base"]["center_of_mass"], bus, atol=1e-15)
    np.testing.assert_allclose(found["base"]["inertia"], np.diag([2.0, 1.0, 2.5]), atol=1e-15)
    (joint,) = found["joints"]
    carried = joint["carries"]
    assert carried["links"] == ["arm", "tool", "finger"]
    center = np.average([arm, finger], axis=0, weights=[2.0, 0.5])
    np.testing.assert_allclose(carried["center_of_mass"], center, atol=1e-15)
    of_arm, of_finger = np.diag([0.2, 0.1, 0.25]), 0.1 * np.eye(3)
    inertia = steiner(2.0, of_arm, arm - center) + steiner(0.5, of_finger, finger - center)
    np.testing.assert_allclose(carried["inertia"], inertia, atol=1e-15)
    whole = np.average([bus, arm, finger], axis=0, weights=[10.0, 2.0, 0.5])
    assert found["whole"]["mass"] == 12.5
    np.testing.assert_allclose(found["whole"]["center_of_mass"], whole, atol=1e-15)
    np.testing.assert_allclose(
        found["whole"]["inertia"],
        steiner(10.0, np.diag([2.0, 1.0, 2.5]), bus - whole)
        + steiner(2.0, of_arm, arm - whole)
        + steiner(0.5, of_finger, finger - whole),
        atol=1e-14,
    )
    assert joint["moves"] == {"links": 3, "mass": 2.5}
    assert (joint["axis"], joint["position"]) == ([0.0, 0.0, -1.0], [0.0, 0.0, 0.5])
    np.testing.assert_allclose(found["tip"]["position"], [1.0, 0.0, 0.75], atol=1e-15)
    np.testing.assert_allclose(found["tip"]["rotation"], np.eye(3), atol=1e-15)
    assert found["reach"] == pytest.approx(np.hypot(1.0, 0.25), abs=1e-15)
    assert found["locked_joints"] == [
        {"name": "grip", "type": "prismatic", "position": 0.25, "follows": False, "joint": "turn"}
    ]


@pytest.mark.parametrize("seed", [3, 6])
def test_masses_and_inertias_are_those_of_pinocchios_own_reader(seed: int) -> None:
    urdf = random_urdf(joints=6, seed=seed)
    found = facts_of(urdf, "bus", "tool")
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    data, q = model.createData(), pin.neutral(model)
    pin.ccrba(model, data, q, np.zeros(model.nv))
    pin.framesForwardKinematics(model, data, q)
    base = data.oMf[model.getFrameId("bus", pin.FrameType.BODY)]
    tip = base.actInv(data.oMf[model.getFrameId("tool", pin.FrameType.BODY)])
    whole, turn = found["whole"], base.rotation
    assert whole["mass"] == pytest.approx(pin.computeTotalMass(model), rel=1e-12)
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(whole["center_of_mass"], base.actInv(data.com[0]), **close)
    np.testing.assert_allclose(whole["inertia"], turn.T @ data.Ig.inertia @ turn, **close)
    np.testing.assert_allclose(found["tip"]["position"], tip.translation, **close)
    np.testing.assert_allclose(found["tip"]["rotation"], tip.rotation, **close)
    pin.computeSubtreeMasses(model, data)
    for joint in found["joints"]:
        number = model.getJointId(joint["name"])
        assert joint["moves"]["mass"] == pytest.approx(data.mass[number], rel=1e-12)
        weight = base.actInv(data.oMi[number]).act(model.inertias[number])
        np.testing.assert_allclose(joint["carries"]["center_of_mass"], weight.lever, **close)
        np.testing.assert_allclose(joint["carries"]["inertia"], weight.inertia, **close)


def test_each_limit_says_where_it_comes_from() -> None:
    (joint,) = facts_of(TURNED, "deck", "tool")["joints"]
    limits = joint["limits"]
    assert (limits["velocity"], limits["effort"]) == (None, None)
    assert limits["from"] == {
        "position": "planner",
        "velocity": "none known",
        "effort": "none known",
    }
    lemur = facts_of(LEMUR_URDF.read_text())["joints"]
    assert {tuple(one["limits"]["from"].values()) for one in lemur} == {3 * ("file",)}
    assert lemur[0]["limits"]["velocity"] == 0.5
    rows = dict(robot_rows(facts_of(TURNED, "deck", "tool")))
    assert rows["    limits"] == (
        "-720 to 720 deg, either way of any turn (planner), any velocity (none known), "
        "any torque (none known)"
    )


def test_a_coupled_joint_says_what_it_follows_and_what_it_carries() -> None:
    mimic = '<mimic joint="turn" multiplier="-0.5" offset="0.25"/><limit lower="-9" upper="9"'
    urdf = TURNED.replace('<limit lower="0.25" upper="0.5"', mimic)
    found = facts_of(urdf, "deck", "tool")
    (one,) = found["coupled_joints"]
    assert (one["name"], one["type"], one["follows"]) == ("grip", "prismatic", "turn")
    assert (one["multiplier"], one["offset"]) == (-0.5, 0.25)
    # With the joint that it follows at zero it is at its offset.
    np.testing.assert_allclose(one["carries"]["center_of_mass"], [1.25, 0.0, 0.5], atol=1e-15)
    assert (one["carries"]["links"], one["carries"]["mass"]) == (["finger"], 0.5)
    assert found["joints"][0]["moves"] == {"links": 3, "mass": 2.5}
    assert found["joints"][0]["carries"]["mass"] == 2.0
    assert dict(robot_rows(found))["  grip"] == "prismatic, coupled: at -0.5 turn +0.25"


def numbers_in(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for one in value:
            yield from numbers_in(one)
    elif isinstance(value, float):
        yield value


def test_the_page_says_what_the_json_says_in_80_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, told = tmp_path / "arm.urdf", tmp_path / "arm.json"
    file.write_text(TURNED)
    command = ["robot", str(file), "--base-link", "deck", "--tip-link", "tool"]
    assert cli.main([*command, "--json", str(told)]) == 0
    page = capsys.readouterr()
    assert page.err == ""
    assert max(map(len, page.out.splitlines())) <= 80
    found = json.loads(told.read_text())
    assert found == json.loads(json.dumps(facts_of(TURNED, "deck", "tool")))
    for part in (found["whole"], found["base"], found["joints"][0]["carries"]):
        for number in numbers_in(part):
            assert abs(number) < 1e-12 or f"{number:g}" in page.out
    shown = " ".join(page.out.split())
    for link in ("bus, deck", "arm, tool, finger"):
        assert link in shown
    for text in (
        *found["notes"],
        "grip prismatic, at 0.25 m, on turn",
        "arm sphere, [0.1] m, on turn",
    ):
        assert text in shown


@pytest.mark.parametrize("seed", [1, 2])
def test_a_page_names_each_body_and_each_pair_that_may_touch(seed: int) -> None:
    robot = random_robot(seed)
    found = robot_facts(robot)
    assert [one["name"] for one in found["bodies"]] == [body.name for body in robot.bodies]
    assert len(found["pairs"]) == len(robot.pairs)
    told = [f"{name} {value}" for name, value in robot_rows(found)]
    for body in robot.bodies:
        assert any(line.split()[0] == body.name for line in told)
    for one in robot.may_touch:
        assert f" {one.link1} - {one.link2}: {one.reason}" in told


def test_a_long_name_stands_in_a_line_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, name = tmp_path / "arm.urdf", "a_joint_whose_name_is_longer_than_a_column"
    file.write_text(TURNED.replace('"turn"', f'"{name}"'))
    assert cli.main(["robot", str(file), "--base-link", "deck", "--tip-link", "tool"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[lines.index(f"  {name}") + 1].strip() == "continuous"


def test_a_refused_file_is_told_in_the_json_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, told = tmp_path / "arm.urdf", tmp_path / "arm.json"
    file.write_text(TURNED.replace('mass value="2"', 'mass value="-2"'))
    assert cli.main(["robot", str(file), "--tip-link", "tool", "--json", str(told)]) == 2
    found = json.loads(told.read_text())
    assert found["status"] == "bad_robot"
    assert "link 'arm' mass is -2.0" in found["message"]
    assert found["message"] in capsys.readouterr().err


@pytest.mark.parametrize("lines", [False, True])
def test_a_picture_has_joints_end_effector_and_centre_of_mass(tmp_path: Path, lines: bool) -> None:
    pictures = [tmp_path / name for name in ("one.svg", "two.svg")]
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(LEMUR_URDF.read_text().replace("joint_3", "$_{joint 3"))
    geometry = ["--geometry", "lines"] if lines else []
    for picture in pictures:
        assert cli.main(["robot", str(urdf), "--picture", str(picture), *geometry]) == 0
    text = pictures[0].read_text()
    for name in ("joint_1", "$_{joint 3", "end effector, end_effector", "centre of mass"):
        assert name in text
    assert text == pictures[1].read_text(), "the same robot, the same file"


def test_a_picture_is_a_png_or_an_svg(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "arm.png"
    assert cli.main(["robot", str(LEMUR_URDF), "--picture", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert cli.main(["robot", str(LEMUR_URDF), "--picture", str(tmp_path / "arm.jpg")]) == 2
    assert "it must end in .svg or .png" in capsys.readouterr().err
