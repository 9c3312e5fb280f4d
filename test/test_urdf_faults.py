"""All faults of a URDF in one run, in a message that a person reads to its end."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from copy import deepcopy
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest
from robots import LEMUR_URDF

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.urdf_body import urdf_body
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.robot.urdf.urdf import checked_urdf
from ff_planner_ros.robot.urdf.urdf_faults import Faults, listed, shortened
from ff_planner_ros.robot.urdf.urdf_xml import SRDF, URDF, read_shapes
from ff_planner_ros.robot.urdf.xml_reader import Format

LEMUR = LEMUR_URDF.read_text()
ENDS = ("chaser", "end_effector")


def set_limit(key: str, value: str) -> Callable[[Element], None]:
    return lambda joint: joint.find("limit").set(key, value)


def set_moment(value: str) -> Callable[[Element], None]:
    return lambda link: link.find("inertial/inertia").set("izz", value)


def set_origin(link: Element) -> None:
    inertial = link.find("inertial")
    for given in inertial.findall("origin"):
        inertial.remove(given)
    inertial.append(Element("origin", xyz="a b c"))


JOINT_FAULTS = {
    "limit velocity is ": set_limit("velocity", "0"),
    "limit effort is ": set_limit("effort", "many"),
    "limit lower is ": set_limit("lower", "9"),
    "limit is missing": lambda joint: joint.remove(joint.find("limit")),
    "is a mimic": lambda joint: joint.append(Element("mimic", joint="joint_9")),
    "is ball": lambda joint: joint.set("type", "ball"),
    "axis is ": lambda joint: joint.find("axis").set("xyz", "0 0 1e-200"),
    "origin xyz is ": lambda joint: joint.find("origin").set("xyz", "1 2"),
}
LINK_FAULTS = {
    "mass is ": lambda link: link.find("inertial/mass").set("value", "1e308"),
    "inertia izz is ": set_moment("nan"),
    "inertia is of principal moments ": set_moment("-3"),
    "inertial origin xyz is ": set_origin,
    "inertial mass is there twice": lambda link: link.find("inertial").append(
        Element("mass", value="5")
    ),
    "with an unknown <intertial>": lambda link: link.append(Element("intertial")),
}


def parts_of(text: str) -> dict[str, tuple[str, ...]]:
    """The attributes of each kind of element in links and joints, visuals left out, by its path."""
    found: dict[str, tuple[str, ...]] = {}
    for tag in ("link", "joint"):
        for owner in ElementTree.fromstring(text).findall(tag):
            waiting = [(tag, owner)]
            for path, element in waiting:
                found.setdefault(path, tuple(element.keys()))
                parts = (one for one in element if one.tag != "visual")
                waiting += [(f"{path}/{one.tag}", one) for one in parts]
    return found


PARTS = parts_of(LEMUR)


def as_robot(text: str) -> None:
    robot_from_urdf_text(text, "chaser", "end_effector")


def as_target(text: str) -> None:
    urdf_body(text, "target_body.urdf")


@pytest.mark.parametrize("read", [as_robot, as_target])
@pytest.mark.parametrize("path", PARTS)
def test_what_is_misspelt_or_there_twice_is_refused_by_name(
    path: str, read: Callable[[str], None]
) -> None:
    """Whatever a URDF holds: an element, each of its attributes, and a second such element."""
    *above, tag = path.split("/")

    def refusal_of(change: Callable[[Element, Element], None]) -> str:
        robot = ElementTree.fromstring(LEMUR)
        owners = robot.findall("/".join(above)) if above else [robot]
        owner = next(one for one in owners if one.find(tag) is not None)
        change(owner, owner.find(tag))
        with pytest.raises(InvalidInput) as refusal:
            read(ElementTree.tostring(robot, encoding="unicode"))
        return str(refusal.value)

    def misspell(_: Element, element: Element) -> None:
        element.tag = f"{tag}x"

    assert f"<{tag}x>" in refusal_of(misspell)
    for name in PARTS[path]:

        def misspell_name(_: Element, element: Element, name: str = name) -> None:
            element.set(f"{name}x", element.attrib.pop(name))

        told = refusal_of(misspell_name)
        assert tag in told, name
        assert f"{name}x" in told or "missing" in told or "nameless" in told or "no type" in told
    if tag != "collision":
        told = refusal_of(lambda owner, element: owner.append(deepcopy(element)))
        assert "there twice" in told or "2 shapes" in told


def within(tag: str, written: str) -> str:
    """The first such element of the URDF with something more in it."""
    return re.sub(rf"(<{tag}\b(?:[^>]*[^/>])?>)", rf"\1{written}", LEMUR, count=1)


PANEL = (
    '<link name="panel"><inertial><mass value="60"/></inertial></link>'
    '<joint name="hinge" type="fixed"><parent link="chaser"/><child link="panel"/></joint>'
)
NOT_EXPANDED = "which is not expanded: run xacro first"


@pytest.mark.parametrize("read", [as_robot, as_target])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (within("robot", f"<group>{PANEL}</group>"), ".urdf <group> is unknown, and holds <link>"),
        (
            within("robot", f"<my:group>{PANEL}</my:group>"),
            ".urdf <my:group> is unknown, and holds <l",
        ),
        (
            within("robot", "<group><link name='a'/></group>"),
            "<group> is unknown, and holds <link>",
        ),
        (
            within("robot", "<inertial/>"),
            ".urdf is with an unknown <inertial>: it may hold link, joint",
        ),
        (within("link", "<origin xyz='0 0 1'/>"), "link 'chaser' is with an unknown <origin>"),
        (within("link", PANEL), "link 'chaser' is with an unknown <link>: it may hold inertial"),
        (
            within("joint", "<orign xyz='0 0 1'/>"),
            "with an unknown <orign>: it may hold origin, parent, child, axis, limit, mimic",
        ),
        (within("joint", "<axes xyz='0 0 1'/>"), "with an unknown <axes>: it may hold origin"),
        (within("link", "<Inertail/>"), "link 'chaser' is with an unknown <Inertail>"),
        (within("link", "<mass value='3'/>"), "link 'chaser' is with an unknown <mass>"),
        (within("link", "<extra><inertial/></extra>"), "<extra> is unknown, and holds <inertial>"),
        (
            within("inertia", "").replace("ixy=", "iyx='9' ixy=", 1),
            "inertia iyx is 9: it must be ixy",
        ),
        (within("inertial", "<pose>1 2 3 0 0 0</pose>"), "inertial is with an unknown <pose>"),
        (LEMUR.replace("<mass ", "<mass unit='g' "), "inertial mass is with an unknown 'unit'"),
        (within("joint", "<origin>1 2 3</origin>"), "origin text is '1 2 3': it must be in attr"),
        (
            re.sub(r"(</geometry>\s*</collision>)", r"<drake:capsule/>\1", LEMUR, count=1),
            "collision geometry is with an unknown <drake:capsule>: it may hold box, capsule",
        ),
        (within("robot", '<xacro:panel side="2"/>'), f"with <xacro:panel>, {NOT_EXPANDED}"),
        (
            within("robot", "<x:panel/>").replace("<robot ", "<robot xmlns:x='http://a/xacro' "),
            f"with <x:panel>, {NOT_EXPANDED}",
        ),
        (within("robot", '<include filename="a"/>'), f"with <include>, {NOT_EXPANDED}"),
        (within("robot", "<gazebo><xacro:a/></gazebo>"), f"with <xacro:a>, {NOT_EXPANDED}"),
        (LEMUR.replace('"1.5 0.1626 0.0"', '"${x} 0 0"'), f"'${{x}} 0 0', {NOT_EXPANDED}"),
        (LEMUR.replace("<inertial>", "<inertial xacro:if='1'>"), f"xacro:if='1', {NOT_EXPANDED}"),
    ],
)
def test_what_is_not_read_and_may_count_is_refused(
    text: str, message: str, read: Callable[[str], None]
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        read(text)
    assert message in str(refusal.value)


@pytest.mark.parametrize(
    ("tag", "written", "notes"),
    [
        ("robot", "<drake:ignore a='b'><drake:x/></drake:ignore>", "<drake:ignore> in <robot>"),
        ("link", "<self_collide>false</self_collide>", ""),
        (
            "joint",
            "<traits spring_k='2.5'/><controller_gains/>",
            "<traits> in <joint>, <controller_gains> in <joint>",
        ),
        ("robot", "<frame name='tcp'/><gazebo><link/></gazebo>", "<frame> in <robot>"),
        ("link", "<my:colour/><my:colour/>", "<my:colour> in <link>"),
        ("robot", "<transmission><joint name='joint_1'/><actuator/></transmission>", ""),
        ("robot", "<ros2_control><joint name='joint_1'><param/></joint></ros2_control>", ""),
        ("robot", "<gazebo><link name='x'><inertial/></link></gazebo><material name='a'/>", ""),
        ("link", "<contact><stiffness value='1'/></contact><self_collision_checking/>", ""),
        ("link", "<origin xyz='0 0 0' rpy='0 -0 0'/>", ""),  # as onshape-to-robot writes it
        ("joint", "<dynamics damping='0'/><safety_controller k_velocity='1'/>", ""),
        ("collision", "<verbose value='x'/><compliant_contact/>", ""),
        ("visual", "<orign/>", ""),
    ],
)
def test_what_is_not_read_and_cannot_count_is_at_most_a_note(
    tag: str, written: str, notes: str
) -> None:
    plain, robot = (
        robot_from_urdf_text(text, "chaser", "end_effector")
        for text in (LEMUR, within(tag, written))
    )
    assert robot.urdf == plain.urdf
    assert robot.drawn_urdf == plain.drawn_urdf
    assert robot.notes == ((f"not read: {notes}", *plain.notes) if notes else plain.notes)


def test_an_inertia_may_have_its_mirrored_entries_too() -> None:
    """As exporters write a symmetric matrix whole."""
    text = re.sub(r'ixy="([^"]*)"', r'ixy="\1" iyx="\1"', LEMUR)
    assert "iyx" in text
    plain, robot = (robot_from_urdf_text(one, "chaser", "end_effector") for one in (LEMUR, text))
    assert robot.urdf == plain.urdf


def test_a_limit_that_no_plan_keeps_is_a_note() -> None:
    text = LEMUR.replace('effort="80.0"', 'effort="80.0" acceleration="1"')
    robot = robot_from_urdf_text(text, "chaser", "end_effector")
    assert "not read: acceleration of <limit>" in robot.notes


def not_read(form: Format) -> list[tuple[str, str]]:
    """Each element of a format with each part and attribute that is not read."""
    return [
        (path.removeprefix(f"{form.root}/"), name)
        for path, row in form.tag.within(form.root)
        for name in (*row.unread, *row.noted)
        if not name.endswith("_collisions")  # read like those of an SRDF
    ]


@pytest.mark.parametrize(("path", "name"), not_read(URDF))
def test_what_a_table_says_is_not_read_changes_no_robot(path: str, name: str) -> None:
    """Whatever is in it; and a note names what the table says is noted."""
    if path.startswith("ros2_control"):
        text = within("robot", "<ros2_control><joint name='joint_1'/></ros2_control>")
    else:
        text = LEMUR if "safety" not in path else within("joint", "<safety_controller/>")
    robot = ElementTree.fromstring(text)
    owner = robot if path == "robot" else robot.find(path)
    assert owner is not None
    if name.startswith("@"):
        owner.set(name[1:], "1")
    else:
        inside = ElementTree.SubElement(owner, name, any="1")
        ElementTree.SubElement(inside, "anything").text = "1"
    changed = robot_from_urdf_text(ElementTree.tostring(robot, "unicode"), *ENDS)
    plain = robot_from_urdf_text(LEMUR, *ENDS)
    assert changed.urdf == plain.urdf
    assert changed.may_touch == plain.may_touch
    row = URDF.tag if path == "robot" else dict(URDF.tag.within("robot"))[f"robot/{path}"]
    told = f"not read: {name.removeprefix('@')} of <" if name in row.noted else None
    assert [note for note in changed.notes if note not in plain.notes and told is None] == []
    assert told is None or any(note.startswith(told) for note in changed.notes)


@pytest.mark.parametrize("name", [name for _, name in not_read(SRDF)])
def test_what_the_table_of_an_srdf_says_is_not_read_lets_no_other_links_touch(name: str) -> None:
    srdf = f"<robot name='lemur'><{name} any='1'><anything/></{name}></robot>"
    changed, plain = (
        robot_from_urdf_text(LEMUR, *ENDS, srdf=text) for text in (srdf, "<robot name='lemur'/>")
    )
    assert changed.pairs == plain.pairs
    assert any(f"<{name}>" in note for note in changed.notes) is (name in SRDF.tag.noted)


def test_a_joint_that_mimics_another_in_ros2_control_alone_is_noted() -> None:
    """A name may hold what a search for it would stumble on."""
    joint = "<joint name=\"joint_'2\"><param name='mimic'>joint_1</param></joint>"
    robot = robot_from_urdf_text(within("robot", f"<ros2_control>{joint}</ros2_control>"), *ENDS)
    told = "joints that mimic another in <ros2_control> alone, which is not modelled"
    assert f"{told}: joint_'2 mimics joint_1" in robot.notes


@pytest.mark.parametrize("base_link", [None, "chaser"])
def test_beside_a_joint_at_fault_no_mass_is_missed(base_link: str | None) -> None:
    """The world has none, and needs none when the chaser is fixed to it."""
    free = (
        '<link name="world"/><joint name="free" type="floating"><parent link="world"/>'
        '<child link="chaser"/></joint>'
    )
    with pytest.raises(InvalidInput) as refusal:
        checked_urdf(within("robot", free), base_link, "end_effector")
    assert str(refusal.value).startswith("joint 'free' is ")


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


LINES_OF_FAULTS = {
    # An attribute is on the line of its element, and what is missing on that of its owner
    "joint 'joint_3' limit velocity is ": (r'(<joint name="joint_3".*?<limit[^>]*velocity=")', "x"),
    "link 'link_5' mass is ": (r'(<link name="link_5">.*?<mass value=")', "-"),
    "link 'link_5' inertia izz is ": (r'(<link name="link_5">.*?<inertia [^>]*izz=")', "x"),
    "joint 'joint_3' origin xyz is ": (r'(<joint name="joint_3".*?<origin [^>]*xyz=")', "x "),
    "joint 'joint_3' child is ": (r'(<joint name="joint_3".*?<child link=")', "no_"),
    "link 'link_5' is with an unknown <intertial>": (
        r'(<link name="link_5">.*?)(?=<inertial>)',
        "<intertial/>",
    ),
}


@pytest.mark.parametrize("read", [as_robot, as_target])
@pytest.mark.parametrize("words", LINES_OF_FAULTS)
def test_a_fault_names_the_line_on_which_its_element_begins(
    words: str, read: Callable[[str], None]
) -> None:
    """As an editor counts, whether lines end by one character or by two."""
    pattern, written = LINES_OF_FAULTS[words]
    found = re.search(pattern, LEMUR, flags=re.DOTALL)
    before = LEMUR[: found.end()]
    text = before + written + LEMUR[found.end() :]
    line = 1 + before[: max(before.rfind("<"), len(before) * ("/>" in written))].count("\n")
    if words.startswith("joint") and read is as_target and "limit" in words:
        read(text)  # limits of a body's joints do not matter
        return
    for lines in (text, text.replace("\n", "\r\n")):
        with pytest.raises(InvalidInput) as refusal:
            read(lines)
        told = str(refusal.value)
        assert words in told
        assert re.search(rf"{re.escape(words)}[^;]* \(line {line}[;)]", told), (line, told)


def test_of_several_shapes_that_at_fault_has_its_line_and_a_part_that_is_none_the_links() -> None:
    shapes = "<collision><geometry>\n<mesh filename='{}.stl'/></geometry></collision>\n"
    text = within("link", "\n" + "".join(map(shapes.format, "ab")))
    with pytest.raises(InvalidInput) as refusal:
        robot_from_urdf_text(text, *ENDS)
    lines = [text[: text.index(f"'{name}.stl'")].count("\n") + 1 for name in "ab"]
    assert f"(line {lines[0]}; likewise 'chaser' on {lines[1]})" in str(refusal.value)
    faults = Faults()
    robot = read_shapes(text, faults)
    faults.add("link", "chaser", "collision origin", "odd", "make it even")
    faults.add("link", "chaser", "inertial mass", "odd", "make it even")
    with pytest.raises(InvalidInput) as refusal:
        faults.refuse_if_any()
    told = str(refusal.value)
    link = robot.find("link[@name='chaser']")
    assert f"even (line {link.line})" in told
    assert f"even (line {link.find('inertial/mass').line})" in told


def test_faults_of_one_kind_have_a_line_each() -> None:
    heavy = re.sub(r'<mass value="[^"]*"/>', '<mass value="x"/>', LEMUR)
    with pytest.raises(InvalidInput) as refusal:
        as_robot(heavy)
    told = str(refusal.value)
    lines = [n for n, line in enumerate(heavy.splitlines(), 1) if "<mass " in line]
    assert [int(line) for line in re.findall(r"(?:line|on) (\d+)", told)] == lines


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
    assert len(shortened(mesh)) <= 203
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
