"""Joints that do not belong to the arm, that slide, or that turn without end."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from planar_model import TESTBED, planar_urdf
from robots import LEMUR_URDF, random_urdf

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters.robot import (
    AUTO,
    RobotParameters,
    WheelParameters,
    locked_joints_of,
)
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.urdf import TURN_OF_CONTINUOUS, checked_urdf
from ff_planner_ros.simulation.engine import Engine


def two_arms() -> str:
    """A bus with an arm on each side, both of the same three links."""
    rng = np.random.default_rng(0)
    arm = planar_urdf(TESTBED, rng)
    other = arm.replace("body_", "other_").replace("joint_", "other_joint_").replace("tip", "hand")
    bus = other.index("</link>") + len("</link>")
    other = other[bus : other.index("</robot>")].replace("other_0", "body_0")
    return arm.replace("</robot>", f"{other}</robot>")


def whole_inertia(robot: Robot, joints: Array) -> Array:
    """Return the system's inertia about the base's origin with the arm so."""
    q = np.concatenate([pin.neutral(robot.model)[:7], joints])
    data = robot.model.createData()
    return np.array(pin.crba(robot.model, data, q))[:6, :6]


def test_one_arm_is_planned_while_the_other_is_held() -> None:
    held = {"other_joint_1": 0.4, "other_joint_2": -1.1, "other_joint_3": 0.7}
    robot = robot_from_urdf_text(two_arms(), "body_0", "tip", Base.PLANAR, held)
    assert robot.joint_names == ("joint_1", "joint_2", "joint_3")
    (note,) = robot.notes
    assert "other_joint_1 at 0.4 rad" in note
    # The whole system as Pinocchio reads the URDF itself, with both arms.
    both = pin.buildModelFromXML(two_arms(), pin.JointModelFreeFlyer())
    q = pin.neutral(both)
    angles = {"joint_1": 0.2, "joint_2": 0.3, "joint_3": -0.4}
    for name, angle in (held | angles).items():
        q[both.joints[both.getJointId(name)].idx_q] = angle
    expected = np.array(pin.crba(both, both.createData(), q))[:6, :6]
    found = whole_inertia(robot, np.array([*angles.values()]))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert Engine(robot).mass == pytest.approx(robot.model.inertias[1].mass + 2.913 + 2.646 + 1.699)


def test_a_joint_that_slides_is_held_where_it_is_said_to_be() -> None:
    rail = LEMUR_URDF.read_text().replace(
        '<joint name="joint_1" type="revolute">', '<joint name="joint_1" type="prismatic">'
    )
    robot = robot_from_urdf_text(rail, "chaser", "end_effector", held_at={"joint_1": 0.25})
    assert robot.joint_names == tuple(f"joint_{k}" for k in range(2, 8))
    assert "joint_1 at 0.25 m" in robot.notes[0]
    free = robot_from_urdf_text(LEMUR_URDF.read_text(), "chaser", "end_effector")
    slid, at_zero = (r.model.jointPlacements[2] for r in (robot, free))
    data = free.model.createData()
    pin.forwardKinematics(free.model, data, pin.neutral(free.model))
    np.testing.assert_allclose(
        slid.translation - data.oMi[3].translation, [0.0, 0.0, 0.25], rtol=0.0, atol=1e-12
    )
    assert at_zero.translation[2] == 0.4


def test_without_a_word_a_joint_is_held_at_zero() -> None:
    robot = robot_from_urdf_text(two_arms(), "body_0", "tip", Base.PLANAR)
    assert "other_joint_3 at 0 rad" in robot.notes[0]


def test_a_joint_that_turns_without_end_is_planned() -> None:
    text = LEMUR_URDF.read_text().replace(
        '<joint name="joint_3" type="revolute">', '<joint name="joint_3" type="continuous">'
    )
    robot = robot_from_urdf_text(text, "chaser", "end_effector")
    assert robot.joints == 7
    assert robot.upper_position_limits[2] == -robot.lower_position_limits[2] == TURN_OF_CONTINUOUS
    limits = 'lower="-3.141592653589793" upper="3.141592653589793" '
    before, joint, after = text.partition('<joint name="joint_3"')
    assert limits in after
    without = before + joint + after.replace(limits, "", 1)
    assert robot_from_urdf_text(without, "chaser", "end_effector").joints == 7
    # As recorded it still is; a joint with as wide limits of its own is not.
    again = robot_from_urdf_text(robot.drawn_urdf, "chaser", "end_effector")
    assert again.continuous == robot.continuous == (False, False, True, *4 * [False])
    assert digest_of(again) == digest_of(robot)
    assert not any(robot_from_urdf_text(robot.urdf, "chaser", "end_effector").continuous)


def test_a_joint_to_be_held_that_is_not_there_is_refused() -> None:
    with pytest.raises(
        InvalidInput, match=r"robot\.locked_joints.*elbow.*joint_1, joint_2, joint_3"
    ):
        checked_urdf(random_urdf(3, 0), "bus", "tool", {"elbow": 0.0})


def test_what_is_fixed_cannot_be_held_elsewhere() -> None:
    with pytest.raises(InvalidInput, match=r"robot\.locked_joints"):
        checked_urdf(random_urdf(3, 0), "bus", "tool", {"tool_mount": 0.3})


def test_what_is_held_must_be_somewhere_that_it_can_be() -> None:
    """Where its position is no number, or none that leaves a body a body."""
    rail = random_urdf(3, 0).replace('"revolute"', '"prismatic"', 1)
    name = robot_from_urdf_text(random_urdf(3, 0), "bus", "tool").joint_names[0]
    with pytest.raises(InvalidInput, match=r"robot\.locked_joints.*size must be at most"):
        checked_urdf(rail, "bus", "tool", {name: 1e300})
    for kind in ("floating", "planar"):
        loose = random_urdf(3, 0).replace('"revolute"', f'"{kind}"', 1)
        with pytest.raises(InvalidInput, match=rf"robot\.locked_joints.*is {kind}: only joints"):
            checked_urdf(loose, "bus", "tool", {name: 0.1})


def test_a_finger_that_moves_along_with_one_that_is_held_is_where_that_one_takes_it() -> None:
    parts = [two_arms().replace("</robot>", "")]
    for finger, side, range_, along in (
        ("left", 1, (0.0, 0.04), ""),
        ("right", -1, (0.0, 0.04), '<mimic joint="left" multiplier="-0.5" offset="0.01"/>'),
        ("third", 1, (0.0, 0.04), '<mimic joint="right" multiplier="2" offset="0.03"/>'),
        ("below", 1, (-0.04, -0.02), ""),
    ):
        parts.append(
            f'<link name="{finger}_finger"><inertial><mass value="0.2"/><inertia ixx="1e-4" '
            'iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{finger}" type="prismatic"><parent link="tip"/>'
            f'<child link="{finger}_finger"/><axis xyz="0 {side} 0"/>'
            f'<limit lower="{range_[0]}" upper="{range_[1]}" velocity="1" effort="1"/>{along}'
            "</joint>"
        )
    robot = robot_from_urdf_text(
        "".join(parts) + "</robot>", "body_0", "tip", held_at={"left": 0.04}
    )
    (note, _) = robot.notes
    assert "left at 0.04 m" in note
    assert "right at -0.01 m" in note
    # One that moves along with that one, and one that comes as near to zero as it can.
    assert "third at 0.01 m" in note
    assert "below at -0.02 m" in note


def with_rods(*rods: tuple[str, str, str, str]) -> str:
    """Return the lemur with rods of 8 kg: name, kind and carrier of its joint, and `<mimic>`."""
    parts = [LEMUR_URDF.read_text().replace("</robot>", "")]
    for name, kind, carrier, mimic in rods:
        parts.append(
            f'<link name="of_{name}"><inertial><origin xyz="0.35 0 0"/><mass value="8"/><inertia '
            'ixx="0.02" iyy="0.25" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="{kind}"><parent link="{carrier}"/>'
            f'<child link="of_{name}"/><origin xyz="0.15 0.3 0"/><axis xyz="0 2 0"/>'
            f'<limit lower="-2.5" upper="2.5" velocity="1" effort="1"/>{mimic}</joint>'
        )
    return "".join(parts) + "</robot>"


ROD = "rod", "revolute", "link_1", '<mimic joint="joint_2" multiplier="-0.5" offset="0.2"/>'
FAR_ROD = "far", "prismatic", "of_rod", '<mimic joint="rod" multiplier="2" offset="-0.1"/>'


@pytest.mark.parametrize("rods", [(ROD,), (FAR_ROD, ROD)])
def test_a_joint_that_mimics_a_planned_joint_cannot_be_locked(
    rods: tuple[tuple[str, str, str, str], ...],
) -> None:
    name = rods[0][0]
    with pytest.raises(InvalidInput) as refused:
        checked_urdf(with_rods(*rods), "chaser", "end_effector", {name: 0.3})
    told = f"robot.locked_joints '{name}' is 0.3: it mimics joint_2, which is planned"
    assert str(refused.value) == f"{told}: lock joint_2 instead"


def test_neither_can_one_of_the_arm_but_it_is_locked_with_the_joint_that_it_mimics() -> None:
    text = LEMUR_URDF.read_text().replace(
        '<joint name="joint_3" type="revolute">',
        '<joint name="joint_3" type="prismatic"><mimic joint="joint_2" multiplier="0.1"/>',
    )
    fault = "'joint_3' is 0.0: it mimics joint_2, which is planned"
    with pytest.raises(InvalidInput, match=fault):
        checked_urdf(text, "chaser", "end_effector", {"joint_3": 0.0})
    # One that slides along with a locked joint is where that joint puts it.
    robot = robot_from_urdf_text(
        text, "chaser", "end_effector", held_at={"joint_2": 1.2}, slide_weight=0.0
    )
    assert "joint_2 at 1.2 rad, joint_3 at 0.12 m" in robot.notes[0]


def test_the_links_of_joints_that_mimic_a_locked_joint_are_where_it_puts_them() -> None:
    text, angle = with_rods(ROD, FAR_ROD), -1.2
    robot = robot_from_urdf_text(text, "chaser", "end_effector", held_at={"joint_2": angle})
    free = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    q = pin.neutral(free)
    at = {"joint_2": angle, "rod": -0.5 * angle + 0.2, "far": 2.0 * (-0.5 * angle + 0.2) - 0.1}
    at |= {"joint_1": 0.3, "joint_3": 0.1, "joint_4": -0.7, "joint_5": 0.2, "joint_6": 1.1}
    for name, position in at.items():
        q[free.joints[free.getJointId(name)].idx_q] = position
    expected = np.array(pin.crba(free, free.createData(), q))[:6, :6]
    found = whole_inertia(robot, np.array([at.get(name, 0.0) for name in robot.joint_names]))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("mimic", "held_at", "words"),
    [
        ("<mimic/>", {}, "joint 'rod' is a mimic of no joint: its <mimic> must name one"),
        ('<mimic joint="rod"/>', {}, "joint 'rod' is in a ring of joints that mimic each other"),
        ('<mimic joint="other"/>', {}, "joint 'rod' is in a ring of joints that mimic each other"),
        (
            '<mimic joint="joint_2" multiplier="two"/>',
            {"joint_2": 0.1},
            "joint 'rod' mimic multiplier is 'two': it must be a finite number",
        ),
        (
            '<mimic joint="joint_2" multiplier="-1"/>',
            {"joint_2": 0.1, "rod": 0.1},
            "robot.locked_joints 'rod' is 0.1: it mimics joint_2, which puts it at -0.1",
        ),
        (
            '<mimic joint="joint_2" multiplier="-1"/>',
            {"joint_2": 0.1, "rod": -0.3},
            "robot.locked_joints 'rod' is -0.3: it mimics joint_2, which puts it at -0.1",
        ),
    ],
)
def test_a_mimic_that_no_robot_can_have_is_refused(
    mimic: str, held_at: dict[str, float], words: str
) -> None:
    other = "other", "revolute", "chaser", '<mimic joint="rod"/>'
    rods = [("rod", "revolute", "link_1", mimic)] + [other] * ("other" in mimic)
    with pytest.raises(InvalidInput) as refused:
        checked_urdf(with_rods(*rods), "chaser", "end_effector", held_at)
    assert words in str(refused.value)


def test_a_joint_that_mimics_one_that_is_not_there_is_locked_by_itself_with_a_note() -> None:
    rods = [("rod", "revolute", "link_1", '<mimic joint="joint_9" offset="1"/>')]
    rods += [("other", "revolute", "chaser", '<mimic joint="rod" offset="0.5"/>')]
    held, note = checked_urdf(with_rods(*rods), "chaser", "end_effector", {"rod": 0.2}).notes
    assert note == "joints that mimic one that is not there: rod mimics joint_9"
    assert held.endswith("other at 0.7 rad, rod at 0.2 rad")


@pytest.mark.parametrize("kind", ["floating", "planar", "ball"])
def test_a_joint_beside_the_arm_that_cannot_be_locked_is_refused(kind: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        checked_urdf(with_rods(("rod", kind, "link_1", "")), "chaser", "end_effector")
    told = f"joint 'rod' is {kind}: it must be revolute, continuous, prismatic or "
    assert str(refused.value).startswith(told)


def test_a_floating_joint_above_the_base_is_the_one_fault_that_is_told() -> None:
    """And not that a link that floats, the world, must have mass."""
    world = (
        '<link name="world"/><joint name="free" type="floating"><parent link="world"/>'
        '<child link="chaser"/></joint></robot>'
    )
    with pytest.raises(InvalidInput) as refused:
        checked_urdf(LEMUR_URDF.read_text().replace("</robot>", world), "chaser", "end_effector")
    told = "joint 'free' is movable and carries the base link: make it fixed (line 294)"
    assert str(refused.value) == told


def test_the_node_is_told_of_held_joints_in_one_line() -> None:
    assert locked_joints_of("") == {}
    assert locked_joints_of("rail: 0.2, other_elbow: -1.5e0,") == {"rail": 0.2, "other_elbow": -1.5}
    told = RobotParameters(
        WheelParameters(), "a.urdf", "body_0", "tip", "planar", "other_joint_1: 0.4", AUTO
    )
    robot = told.load(two_arms())
    assert robot.base is Base.PLANAR
    assert "other_joint_1 at 0.4 rad" in robot.notes[0]


@pytest.mark.parametrize(
    "text", ["rail", "rail: far", "rail: nan", "rail: 0.1 hand: 0.2", "rail: 0.1, rail: 0.2"]
)
def test_locked_joints_that_are_no_list_of_positions_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match=r"robot\.locked_joints"):
        locked_joints_of(text)
