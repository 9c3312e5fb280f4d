"""Random robots of the kinds that published files hold, as Pinocchio's own reader reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from others_reader import put, require_same

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.urdf_body import urdf_body
from ff_planner_ros.robot.model import robot_from_urdf_text

MISSING = '<geometry><mesh filename="package://nowhere/link.stl"/></geometry>'
# What files hold beside links and joints, and no plan depends on.
AROUND = """<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
<transmission name="t"><type>transmission_interface/SimpleTransmission</type>
  <joint name="a_1"><hardwareInterface>PositionJointInterface</hardwareInterface></joint>
  <actuator name="m"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>
<gazebo reference="bus"><selfCollide>true</selfCollide><mu1>0.9</mu1></gazebo>"""


class Published:
    """A chaser with an arm, a gripper whose second finger mimics the first, and perhaps two arms.

    Between the joints are fixed links, with and without mass. `locked` has where the joints are
    that do not move: as given, by the mimic's formula, at zero or at the limit nearest to it.
    """

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.parts = [AROUND]
        self.held, self.locked = dict[str, float](), dict[str, float]()
        self.link("bus", self.rng.uniform(50.0, 500.0))
        self.base = "bus"
        if seed % 2:
            self.joint("deck_mount", "fixed", "bus", "deck")
            self.link("deck", 0.0)
            self.base = "deck"
        self.tip = self.arm("a", self.base, locked=False)
        self.gripper("a", self.tip)
        self.coupled = dict[str, tuple[str, float, float]]()
        if seed % 4 == 1:
            self.flap()
        if seed % 3 == 0:
            self.gripper("b", self.arm("b", "bus", locked=True))
        self.text = f"<robot name='published'>{''.join(self.parts)}</robot>"

    def numbers(self, low: float, high: float) -> str:
        return " ".join(map(repr, self.rng.uniform(low, high, 3).tolist()))

    def origin(self) -> str:
        return f'<origin xyz="{self.numbers(-0.5, 0.5)}" rpy="{self.numbers(-3.0, 3.0)}"/>'

    def link(self, name: str, mass: float) -> None:
        inertial = shapes = ""
        if mass:
            points = self.rng.uniform(-0.2, 0.2, (8, 3))
            points -= points.mean(axis=0)
            inertia = mass / 8 * sum((p @ p) * np.eye(3) - np.outer(p, p) for p in points)
            entries = " ".join(
                f'i{"xyz"[i]}{"xyz"[j]}="{inertia[i, j]!r}"'
                for i, j in zip(*np.triu_indices(3), strict=True)
            )
            entries = entries.replace("np.float64(", "").replace(")", "")
            inertial = (
                f'<inertial>{self.origin()}<mass value="{mass!r}"/><inertia {entries}/></inertial>'
            )
        for number in range(int(self.rng.integers(0, 4))):
            shapes += f'<visual name="v{number}">{self.origin()}{MISSING}</visual>'
        for size in self.rng.uniform(0.02, 0.1, int(self.rng.integers(0, 3))).tolist():
            sphere = f'<geometry><sphere radius="{size!r}"/></geometry>'
            shapes += f"<collision>{self.origin()}{sphere}</collision>"
        self.parts.append(f'<link name="{name}">{inertial}{shapes}</link>')

    def joint(self, name: str, kind: str, parent: str, child: str, more: str = "") -> None:
        axis = "" if kind == "fixed" else f'<axis xyz="{self.numbers(-1.0, 1.0)}"/>'
        ends = f'<parent link="{parent}"/><child link="{child}"/>'
        self.parts.append(
            f'<joint name="{name}" type="{kind}">{self.origin()}{ends}{axis}{more}</joint>'
        )

    def limited(self, kind: str, name: str, locked: bool) -> str:
        """Return limits of a joint, and remember where it is locked."""
        if kind == "continuous":
            low, high, limit = -np.inf, np.inf, ""
        else:
            low, high = sorted(self.rng.uniform(-1.0, 2.0, 2).tolist())
            limit = f'<limit lower="{low!r}" upper="{high!r}" velocity="1" effort="10"/>'
        if locked and self.rng.random() < 0.5:
            self.held[name] = self.locked[name] = float(self.rng.uniform(-2.0, 2.0))
        elif locked:
            self.locked[name] = min(max(0.0, low), high)
        return limit + '<dynamics damping="0.1" friction="0.2"/>'

    def arm(self, arm: str, carrier: str, locked: bool) -> str:
        """Add an arm with fixed links between its joints; return the link at its end."""
        for number in range(1, int(self.rng.integers(2, 8))):
            if self.rng.random() < 0.4:
                frame = f"{arm}_frame_{number}"
                self.joint(f"{frame}_mount", "fixed", carrier, frame)
                self.link(frame, float(self.rng.choice([0.0, 0.3])))
                carrier = frame
            kind = str(self.rng.choice(["revolute", "continuous", "prismatic"], p=[0.6, 0.3, 0.1]))
            name, link = f"{arm}_{number}", f"{arm}_link_{number}"
            self.joint(name, kind, carrier, link, self.limited(kind, name, locked))
            self.link(link, self.rng.uniform(0.5, 8.0))
            carrier = link
        self.joint(f"{arm}_flange", "fixed", carrier, f"{arm}_tool")
        self.link(f"{arm}_tool", 0.0)
        return f"{arm}_tool"

    def flap(self) -> None:
        """Add a joint on the base that moves along with the arm's first one."""
        factor, offset = self.rng.uniform(-1.5, 1.5, 2).tolist()
        self.coupled["flap"] = "a_1", factor, offset
        mimic = f'<mimic joint="a_1" multiplier="{factor!r}" offset="{offset!r}"/>'
        limit = '<limit lower="-99" upper="99" velocity="1" effort="1"/>'
        self.joint("flap", "revolute", self.base, "flap_link", limit + mimic)
        self.link("flap_link", 3.0)

    def gripper(self, arm: str, carrier: str) -> None:
        first, second = f"{arm}_finger_1", f"{arm}_finger_2"
        self.joint(
            first, "prismatic", carrier, f"{first}_link", self.limited("prismatic", first, True)
        )
        self.link(f"{first}_link", 0.2)
        factor, offset = self.rng.uniform(-1.5, 1.5, 2).tolist()
        mimic = f'<mimic joint="{first}" multiplier="{factor!r}" offset="{offset!r}"/>'
        limit = '<limit lower="-9" upper="9" velocity="1" effort="1"/>'
        self.joint(second, "revolute", carrier, f"{second}_link", limit + mimic)
        self.link(f"{second}_link", 0.2)
        self.locked[second] = factor * self.locked[first] + offset


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(200))
def test_a_robot_is_read_as_pinocchio_reads_it(seed: int) -> None:
    one = Published(seed)
    robot = robot_from_urdf_text(one.text, one.base, one.tip, held_at=one.held)
    assert {joint.name: joint.position for joint in robot.locked_joints if not joint.is_fixed} == (
        pytest.approx(one.locked, abs=1e-15)
    )
    require_same(robot, one.text, one.locked, coupled=one.coupled)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(100))
def test_a_file_is_the_same_body_as_a_robot_with_all_joints_locked(seed: int) -> None:
    """Of a target body all joints are locked: total mass and inertia are Pinocchio's."""
    one = Published(seed)
    planned = set(robot_from_urdf_text(one.text, one.base, one.tip).joint_names)
    model = pin.buildModelFromXML(one.text, pin.JointModelFreeFlyer())
    rng = np.random.default_rng(seed)
    at = one.held | {name: float(rng.uniform(-1.0, 1.0)) for name in planned - one.locked.keys()}
    body = urdf_body(one.text, "target_body.urdf", locked_joints=at)
    data, q = model.createData(), pin.neutral(model)
    at = dict.fromkeys(planned, 0.0) | one.locked | at
    at |= {name: times * at[of] + more for name, (of, times, more) in one.coupled.items()}
    for name, position in at.items():
        put(model, q, name, position)
    pin.ccrba(model, data, q, np.zeros(model.nv))
    assert body.mass == pytest.approx(data.Ig.mass, rel=1e-12)
    wanted = data.Ig.inertia
    np.testing.assert_allclose(body.inertia, wanted, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(3))
def test_a_collision_mesh_that_is_missing_is_named_and_lines_need_none(
    seed: int, tmp_path: Path
) -> None:
    one = Published(seed)
    text = one.text.replace("<visual ", "<collision ").replace("</visual>", "</collision>")
    with pytest.raises(InvalidInput, match=r"package://nowhere/link\.stl: no package 'nowhere'"):
        robot_from_urdf_text(text, one.base, one.tip, held_at=one.held, directory=tmp_path)
    lines = Geometry.LINES
    robot = robot_from_urdf_text(text, one.base, one.tip, held_at=one.held, geometry=lines)
    require_same(robot, text, one.locked, 2, one.coupled)
