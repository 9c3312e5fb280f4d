"""All faults of a URDF in one run, in a message that a person reads to its end."""

from __future__ import annotations

import random
from collections.abc import Callable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest
from robots import LEMUR_URDF

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.urdf.urdf import checked_urdf
from ff_planner_ros.robot.urdf.urdf_faults import Faults, listed, shortened

LEMUR = LEMUR_URDF.read_text()


def set_limit(key: str, value: str) -> Callable[[Element], None]:
    return lambda joint: joint.find("limit").set(key, value)


def set_moment(value: str) -> Callable[[Element], None]:
    return lambda link: link.find("inertial/inertia").set("izz", value)


JOINT_FAULTS = {
    "limit velocity is ": set_limit("velocity", "0"),
    "limit effort is ": set_limit("effort", "many"),
    "limit lower is ": set_limit("lower", "9"),
    "limit is missing": lambda joint: joint.remove(joint.find("limit")),
    "is a mimic": lambda joint: joint.append(Element("mimic", joint="joint_1")),
    "is ball": lambda joint: joint.set("type", "ball"),
    "axis is ": lambda joint: joint.find("axis").set("xyz", "0 0 1e-200"),
    "origin xyz is ": lambda joint: joint.find("origin").set("xyz", "1 2"),
}
LINK_FAULTS = {
    "mass is ": lambda link: link.find("inertial/mass").set("value", "1e308"),
    "inertia izz is ": set_moment("nan"),
    "inertia is of principal moments ": set_moment("-3"),
    "inertial origin xyz is ": lambda link: link.find("inertial").insert(
        0, Element("origin", xyz="a b c")
    ),
}


@pytest.mark.law("FILE-03")
@pytest.mark.parametrize("seed", range(20))
def test_every_fault_is_told_in_one_run(seed: int) -> None:
    """Drawn: which of the joints and links have which fault."""
    chance = random.Random(seed)
    robot = ElementTree.fromstring(LEMUR)
    expected = []
    for tag, faults in (("joint", JOINT_FAULTS), ("link", LINK_FAULTS)):
        for number in chance.sample(range(1, 8), chance.randint(1, 7)):
            name, words = f"{tag}_{number}", chance.choice(list(faults))
            faults[words](robot.find(f"{tag}[@name='{name}']"))
            expected.append((name, words))
    with pytest.raises(InvalidInput) as refusal:
        checked_urdf(ElementTree.tostring(robot, encoding="unicode"), "chaser", "end_effector")
    told = str(refusal.value)
    assert len(told) <= 1000
    assert f"robot.urdf is at fault in {len(expected)} places: " in told
    for name, words in expected:
        assert f"'{name}'" in told, (name, words, told)
        assert words in told, (name, words, told)


def test_faults_of_the_tree_and_of_the_numbers_are_told_together() -> None:
    broken = LEMUR.replace('<child link="link_6"/>', "").replace('effort="80.0"', 'effort="-1"')
    broken = broken.replace("</robot>", '<link name="link_1"/></robot>')
    with pytest.raises(InvalidInput) as refusal:
        checked_urdf(broken.replace('<mass value="6.0"/>', '<mass value="-6"/>'), "chaser", "tool")
    told = str(refusal.value)
    for words in (
        "link 'link_1' is there twice",
        "joint 'joint_6' child is missing",
        "robot.tip_link is tool: it must be one of",
        "link 'link_3' mass is -6.0",
    ):
        assert words in told


def test_many_faults_are_counted_and_as_many_named_as_a_message_holds() -> None:
    faults = Faults()
    for number in range(5000):
        faults.add("joint", f"joint_{number}" + "n" * 100, "", "odd", "make it even")
        faults.add("link", f"link_{number}", "mass", number, "make it 5")
    with pytest.raises(InvalidInput) as refusal:
        faults.refuse_if_any()
    told = str(refusal.value)
    assert refusal.value.status is Status.BAD_ROBOT
    assert len(told) <= 950
    assert told.startswith("robot.urdf is at fault in 10000 places: joint 'joint_0nnn")
    assert "(likewise 'link_1', 'link_2'" in told
    assert "more)" in told


def test_names_are_shown_whole_and_without_what_a_terminal_obeys() -> None:
    assert shortened("gripper") == "gripper"
    assert shortened("\x1b[31m\n") == "?[31m?"
    assert shortened("n" * 200) == "n" * 200
    mesh = "package://" + "many/directories/" * 20 + "meshes_iiwa/link_4.stl"
    assert shortened(mesh).startswith("package://many")
    assert shortened(mesh).endswith("/meshes_iiwa/link_4.stl")
    assert len(shortened(mesh)) == 203
    assert listed([]) == ""


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["a", "b", "c"], "a, b and 1 more"),
        (["aaaa", "b"], "aaaa and 1 more"),
        (["aaaaaaaaa", "b", "c"], "aaaaaaaaa and 2 more"),
        (["aa", "bb"], "aa, bb"),
        (["a"], "a"),
    ],
)
def test_a_list_holds_whole_names_and_counts_those_left_out(names: list[str], told: str) -> None:
    assert listed(names, longest=6) == told


def test_notes_hold_whole_names_and_positions() -> None:
    """Of a gripper with names of 38 characters, as astronauts' helpers have."""
    name = "top_aft_gripper_right_proximal_joint_{}"
    fingers = "".join(
        f'<link name="f{number}"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" '
        'izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{name.format(number)}" type="revolute"><parent link="end_effector"/>'
        f'<child link="f{number}"/><limit lower="0.654321" upper="1" velocity="1" effort="1"/>'
        "</joint>"
        for number in range(80)
    )
    text = LEMUR.replace("</robot>", fingers + "</robot>")
    (note,) = checked_urdf(text, tip_link="end_effector").notes
    told = [f"{name.format(number)} at 0.654321 rad" for number in range(80)]
    whole, _, more = note.partition(": ")[2].rpartition(" and ")
    count = whole.count(",") + 1
    assert whole == ", ".join(told[:count])
    assert more == f"{80 - count} more"
    assert count > 60


def test_kinds_of_faults_that_a_message_cannot_hold_are_counted() -> None:
    faults = Faults()
    for number in range(30):
        faults.add("joint", f"joint_{number}", "", "odd", f"make it {number} and {'n' * 50}")
    with pytest.raises(InvalidInput) as refusal:
        faults.refuse_if_any()
    told = str(refusal.value)
    kinds = told.count("is odd: make it")
    assert len(told) <= 950
    assert told.endswith(f"; {30 - kinds} more kinds of faults")
