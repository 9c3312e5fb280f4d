"""Which links must not touch: against MoveIt's words, and postures counted by Coal alone."""

import itertools
import re
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest
from robots import random_urdf
from test_wild_robots import ARMS, file_of, on_a_chaser

from ff_planner_ros import cli
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.pairs import touching_share
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text

ENDS = ("bus", "tool")
# https://github.com/ros-industrial/universal_robot, ur5_moveit_config: what it writes for UR5.
UR5_ADJACENT = {
    *(("base_link", "shoulder_link"), ("shoulder_link", "upper_arm_link")),
    *(("upper_arm_link", "forearm_link"), ("forearm_link", "wrist_1_link")),
    *(("wrist_1_link", "wrist_2_link"), ("wrist_2_link", "wrist_3_link")),
    ("wrist_3_link", "ee_link"),
}
UR5_NEVER = {
    *(("wrist_1_link", "wrist_3_link"), ("wrist_1_link", "ee_link"), ("wrist_2_link", "ee_link")),
}


def unordered(pairs: set[tuple[str, str]]) -> set[frozenset[str]]:
    return {frozenset(pair) for pair in pairs}


def links_of(robot: Robot) -> set[frozenset[str]]:
    """The links of the pairs that must not touch."""
    return {frozenset(robot.bodies[k].link for k in pair) for pair in robot.pairs}


def wrist(solid: str = '<box size="0.08 0.08 0.08"/>') -> str:
    """The random arm: links 2, 3 and 4 with joints in one point and a solid about it."""
    text = random_urdf(joints=4, seed=3)
    for joint in ("joint_3", "joint_4"):
        text = re.sub(rf'(<joint name="{joint}".*?<origin xyz=)"[^"]*"', r'\1"0 0 0"', text)
    collision = f"<collision><geometry>{solid}</geometry></collision>"
    for link in ("bus", "link_1", "link_2", "link_3", "link_4"):
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{collision}')
    return text


@pytest.fixture(scope="module")
def ur5() -> Robot:
    file = file_of(ARMS["ur5"].urdf)
    return robot_from_urdf_text(
        on_a_chaser(file), "chaser", ARMS["ur5"].tip_link, directory=file.parent
    )


def test_a_ur5_is_kept_apart_but_for_neighbours(ur5: Robot) -> None:
    links = ("base_link", "shoulder_link", "upper_arm_link", "forearm_link")
    links += ("wrist_1_link", "wrist_2_link", "wrist_3_link", "ee_link")
    wanted = unordered(set(itertools.combinations(links, 2))) - unordered(UR5_ADJACENT)
    assert links_of(ur5) == wanted
    assert {(pair.link1, pair.link2) for pair in ur5.may_touch} == UR5_ADJACENT - {
        ("wrist_3_link", "ee_link")  # fixed to each other
    }
    assert not any("touch" in note for note in ur5.notes)


def test_an_srdf_is_written_as_moveits_assistant_writes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    srdf, arm = tmp_path / "ur5.srdf", ARMS["ur5"]
    command = ["robot", str(file_of(arm.urdf)), "--tip-link", arm.tip_link, "--srdf", str(srdf)]
    assert cli.main(command) == 0
    assert f"{srdf}: 10 pairs of links that may touch" in capsys.readouterr().out
    found: dict[str, set[frozenset[str]]] = {}
    for element in ElementTree.parse(srdf).getroot().iter("disable_collisions"):
        links = frozenset((element.get("link1"), element.get("link2")))
        found.setdefault(element.get("reason"), set()).add(links)
    assert found == {"Adjacent": unordered(UR5_ADJACENT), "Never": unordered(UR5_NEVER)}

    robot = load_robot(file_of(arm.urdf), "base_link", arm.tip_link, srdf=srdf)
    free = load_robot(file_of(arm.urdf), "base_link", arm.tip_link)
    assert links_of(robot) == links_of(free) - unordered(UR5_NEVER)
    handed_on = robot_from_urdf_text(robot.drawn_urdf, "base_link", arm.tip_link)
    assert handed_on.pairs == robot.pairs

    assert cli.main(command) == 2, "it is there"
    assert "it is there" in capsys.readouterr().err


def test_links_that_touch_in_every_posture_may(capsys: pytest.CaptureFixture[str]) -> None:
    robot = robot_from_urdf_text(wrist(), *ENDS)
    told = {frozenset(pair[:2]): pair.reason for pair in robot.may_touch}
    assert told.pop(frozenset(("link_2", "link_4"))) == "Always"
    assert set(told.values()) == {"Adjacent"}
    assert links_of(robot) == unordered(
        {("bus", "link_2"), ("bus", "link_3"), ("bus", "link_4")}
        | {("link_1", "link_3"), ("link_1", "link_4")}
    )
    (note,) = robot.notes
    assert "touch in nearly every posture: link_2 and link_4" in note
    assert capsys.readouterr() == ("", "")


def test_shares_are_those_that_coal_counts(ur5: Robot) -> None:
    """Placed by the kinematics of one posture after the other, with its own collide."""
    rng, data, samples = np.random.default_rng(0), ur5.model.createData(), 300
    counts = np.zeros(len(ur5.pairs))
    for _ in range(samples):
        q = pin.neutral(ur5.model)
        q[7:] = rng.uniform(ur5.lower_position_limits, ur5.upper_position_limits)
        pin.forwardKinematics(ur5.model, data, q)
        places = [data.oMi[body.joint] * body.placement_in_joint for body in ur5.bodies]
        there = [coal.Transform3s(place.rotation, place.translation) for place in places]
        for number, (i, j) in enumerate(ur5.pairs):
            result = coal.CollisionResult()
            solids = ur5.bodies[i].solid, ur5.bodies[j].solid
            coal.collide(solids[0], there[i], solids[1], there[j], coal.CollisionRequest(), result)
            counts[number] += result.isCollision()
    assert counts.any()
    shares = touching_share(ur5.model, ur5.bodies, ur5.pairs, samples)
    np.testing.assert_array_equal(shares, counts / samples)


def disabling(*pairs: tuple[str, str]) -> str:
    lines = (f'<disable_collisions link1="{a}" link2="{b}" reason="by hand"/>' for a, b in pairs)
    return f'<robot name="any"><group name="arm"/>{"".join(lines)}</robot>'


def test_with_an_srdf_its_pairs_and_neighbours_may_touch_and_no_others() -> None:
    given = disabling(("link_4", "bus"), ("bus", "camera"), ("link_1", "link_2"))
    robot = robot_from_urdf_text(wrist(), *ENDS, srdf=given)
    assert links_of(robot) == unordered(
        {("bus", "link_2"), ("bus", "link_3"), ("link_1", "link_3"), ("link_1", "link_4")}
        | {("link_2", "link_4")}
    )
    reasons = {frozenset(pair[:2]): pair.reason for pair in robot.may_touch}
    assert reasons[frozenset(("bus", "link_4"))] == "by hand"
    assert frozenset(("bus", "camera")) not in reasons, "camera has no solid"
    again = robot_from_urdf_text(robot.drawn_urdf, *ENDS)
    assert (again.pairs, again.may_touch) == (robot.pairs, robot.may_touch)
    assert again.drawn_urdf == robot.drawn_urdf


ALL_OF_LINK_4 = '<disable_default_collisions link="link_4"/>'
EN_AND_DISABLED = (
    '<enable_collisions link1="bus" link2="link_2"/>'
    '<disable_collisions link1="link_2" link2="bus"/>'
)


@pytest.mark.parametrize(
    ("elements", "less", "more"),
    [
        (ALL_OF_LINK_4, {("bus", "link_4"), ("link_1", "link_4"), ("link_2", "link_4")}, set()),
        (
            f'{ALL_OF_LINK_4}<enable_collisions link1="link_4" link2="bus"/>',
            {("link_1", "link_4"), ("link_2", "link_4")},
            set(),
        ),
        ('<enable_collisions link1="bus" link2="link_1"/>', set(), {("bus", "link_1")}),
        (EN_AND_DISABLED, {("bus", "link_2")}, set()),
    ],
)
def test_an_srdf_lets_a_link_touch_all_but_some_as_moveit_does(
    elements: str, less: set[tuple[str, str]], more: set[tuple[str, str]]
) -> None:
    """A pair by name comes before a link's default, and to disable before to enable."""
    empty = robot_from_urdf_text(wrist(), *ENDS, srdf="<robot/>")
    robot = robot_from_urdf_text(wrist(), *ENDS, srdf=f"<robot>{elements}</robot>")
    assert links_of(robot) == links_of(empty) - unordered(less) | unordered(more)
    again = robot_from_urdf_text(robot.drawn_urdf, *ENDS)
    assert (again.pairs, again.drawn_urdf) == (robot.pairs, robot.drawn_urdf)


@pytest.mark.parametrize(
    ("srdf", "words"),
    [
        ('<robot><enable_collisions link1="a" link2="bus"/></robot>', "enable_collisions link is"),
        ('<robot><disable_default_collisions link="a"/></robot>', "default_collisions link is a"),
        (disabling(("bus", "hand")), "robot.srdf disable_collisions link is hand: it must be one"),
        (disabling(("bus", "")), "robot.srdf disable_collisions link is missing"),
        (disabling(("a", "b"), ("c", "bus")), "at fault in 3 places"),
        ("<robot><xacro:a/></robot>", "robot.srdf is with <xacro:a>, which is not expanded: run"),
        (wrist(), "robot.srdf is with an unknown <link>: it may hold dis"),
        (disabling(("${p}bus", "link_1")), "robot.srdf is with link1='.{p}bus', which is not exp"),
        (
            '<robot><disable_collisions link1="bus" link2="link_1" why="x"/></robot>',
            "robot.srdf disable_collisions is with an unknown 'why': it may have link1",
        ),
        ("", "robot.srdf is not XML"),
        ("<robot", "robot.srdf is not XML"),
        ("<srdf/>", "robot.srdf is a <srdf>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><robot/>', "robot.srdf is with declarations"),
        (
            f"<robot>{'<disable_collisions/>' * 100_001}</robot>",
            "at most 100000 disable_collisions",
        ),
    ],
)
def test_an_srdf_that_does_not_fit_is_refused_by_name(srdf: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        robot_from_urdf_text(wrist(), *ENDS, srdf=srdf)
    robot_from_urdf_text(wrist(), *ENDS, srdf=srdf, geometry=Geometry.LINES)


def test_an_srdf_file_is_read_beside_a_urdf_file(tmp_path: Path) -> None:
    urdf, srdf = tmp_path / "arm.urdf", tmp_path / "arm.srdf"
    urdf.write_text(wrist())
    with pytest.raises(InvalidInput, match=r"robot.srdf is .*arm.srdf: it cannot be read: No such"):
        load_robot(urdf, *ENDS, srdf=srdf)
    srdf.write_text(disabling(("bus", "link_2")))
    robot = load_robot(urdf, *ENDS, srdf=srdf)
    assert frozenset(("bus", "link_2")) not in links_of(robot)


def test_only_shapes_of_the_arm_make_shapes_the_default() -> None:
    """Else spheres would be kept clear of a chaser that stands still, and of no arm."""
    plain = random_urdf(joints=4, seed=3)
    solid = '<collision><geometry><sphere radius="0.2"/></geometry></collision>'
    chaser = plain.replace('<link name="bus">', f'<link name="bus">{solid}')
    robot = robot_from_urdf_text(chaser, *ENDS)
    assert robot.geometry is Geometry.LINES
    assert "no link of the arm has a <collision>" in robot.notes[-1]
    with pytest.raises(InvalidInput, match=r"robot\.geometry is shapes: no link of the arm has"):
        robot_from_urdf_text(chaser, *ENDS, geometry=Geometry.SHAPES)


def test_a_robot_with_lines_has_no_srdf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(random_urdf(joints=4, seed=3))
    command = ["robot", str(urdf), "--tip-link", "tool", "--srdf", str(tmp_path / "arm.srdf")]
    assert cli.main(command) == 2
    assert "only links with a <collision> can touch" in capsys.readouterr().err
    assert not (tmp_path / "arm.srdf").exists()


def test_an_srdf_that_is_of_another_robot_or_holds_what_is_not_read_has_a_note() -> None:
    name = ElementTree.fromstring(wrist()).get("name")
    known = '<group name="arm"><link name="bus"/></group><virtual_joint/><gripper/>'

    def notes(robot: str, elements: str, geometry: Geometry | None = None) -> set[str]:
        srdf = f'<robot name="{robot}">{elements}</robot>'
        return set(robot_from_urdf_text(wrist(), *ENDS, srdf=srdf, geometry=geometry).notes)

    usual = notes(name, known)
    assert notes("other", known) - usual == {f"robot.srdf is of robot other, the URDF of {name}"}
    for written in ("<enable_colisions/>", "<enable_colisions><link name='a'/></enable_colisions>"):
        assert notes(name, written) - usual == {"not read: <enable_colisions> in <robot>"}
    assert "robot.srdf is not read: robot.geometry is lines" in notes(name, known, Geometry.LINES)
