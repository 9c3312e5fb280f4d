"""URDFs that are refused, and by which name."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from robots import CANADARM2_URDF, LEMUR_URDF, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.urdf import checked_urdf

LEMUR = LEMUR_URDF.read_text()
TESTBED_URDF = LEMUR_URDF.parents[1] / "planar_testbed/planar_testbed.urdf"
LINK_3_INERTIA = 'ixx="1.1304" iyy="1.1304" izz="0.0108" ixy="0.0" ixz="0.0" iyz="0.0"'
JOINT_1_LIMIT = (
    '<limit lower="-3.141592653589793" upper="3.141592653589793" velocity="0.5" effort="80.0"/>'
)

REFUSALS = {
    "no_xml": (LEMUR, "no robot at all", "robot.urdf is not XML: "),
    "cut_off": (LEMUR[-500:], "", "robot.urdf is not XML: "),
    "another_document": (LEMUR, "<sdf/>", "robot.urdf is a <sdf>: its outermost tag must be"),
    "nameless_link": (
        '<link name="link_5">',
        "<link>",
        "link number 7 is nameless: it must have a n",
    ),
    "link_twice": ('<link name="link_5">', '<link name="link_4">', "link 'link_4' is there twice"),
    "joint_twice": ('name="joint_2"', 'name="joint_1"', "joint 'joint_1' is there twice"),
    "no_parent": (
        '<parent link="link_3"/>',
        "",
        "joint 'joint_4' parent is missing: it must be one of the URDF's links: chaser, end_eff",
    ),
    "unknown_child": (
        '<child link="link_3"/>',
        '<child link="link_X"/>',
        "joint 'joint_3' child is link_X: it must be one of the URDF's links: chaser, end_eff",
    ),
    "two_parents": (
        '<child link="link_5"/>',
        '<child link="link_4"/>',
        "joint 'joint_5' child is link_4: joint 'joint_4' carries that link already",
    ),
    "loop": (
        '<parent link="link_1"/>',
        '<parent link="link_5"/>',
        "link 'end_effector' is in a loop of joints, or hangs on one: the links must form a tree",
    ),
    "two_roots": (
        "</robot>",
        '<link name="debris"/></robot>',
        "root link is chaser, debris: there must be exactly one",
    ),
    "untyped": (
        'name="joint_3" type="revolute"',
        'name="joint_3"',
        "joint 'joint_3' is of no type: it must be revolute, prismatic or fixed",
    ),
    "mimic": (
        '<child link="link_3"/>',
        '<child link="link_3"/><mimic joint="joint_9"/>',
        "joint 'joint_3' is a mimic: the joint that it mimics is not there",
    ),
    "axis_without_direction": (
        '<axis xyz="0 1 0"/>',
        '<axis xyz="0 0 0"/>',
        "joint 'joint_5' axis is 0.0 0.0 0.0: it must have a direction",
    ),
    "axis_of_two": (
        '<axis xyz="0 1 0"/>',
        '<axis xyz="0 1"/>',
        "joint 'joint_5' axis xyz is '0 1': it must be three finite numbers",
    ),
    "origin_not_finite": (
        'xyz="1.5 0.1626 0.0"',
        'xyz="1.5 nan 0.0"',
        "joint 'joint_5' origin xyz is '1.5 nan 0.0': it must be three finite numbers",
    ),
    "inertial_origin_of_words": (
        '<origin xyz="0.525 0.1626 0.0"/>',
        '<origin xyz="half way up"/>',
        "link 'link_4' inertial origin xyz is 'half way up': it must be three finite numbers",
    ),
    "no_limit": (JOINT_1_LIMIT, "", "joint 'joint_1' limit is missing: it needs lower, upper"),
    "no_lower_limit": (
        'lower="-3.141592653589793" ',
        "",
        "joint 'joint_1' limit lower is missing: it must be a number",
    ),
    "infinite_upper_limit": (
        'upper="3.141592653589793"',
        'upper="inf"',
        "joint 'joint_1' limit upper is 'inf': it must be a finite number",
    ),
    "limits_crossed": (
        'lower="-3.141592653589793"',
        'lower="3.2"',
        "joint 'joint_1' limit lower is 3.2: it must be below upper, 3.14159",
    ),
    "no_velocity": (
        'velocity="0.5"',
        'velocity="0"',
        "joint 'joint_1' limit velocity is 0.0: it must be at least 1e-12",
    ),
    "velocity_in_words": (
        'velocity="0.5"',
        'velocity="slow"',
        "joint 'joint_1' limit velocity is 'slow': it must be a finite number",
    ),
    "negative_effort": (
        'effort="80.0"',
        'effort="-1"',
        "joint 'joint_1' limit effort is -1.0: it must not be negative; 0 means unknown",
    ),
    "negative_mass": (
        '<mass value="6.0"/>',
        '<mass value="-6.0"/>',
        "link 'link_3' mass is -6.0: it must not be negative",
    ),
    "mass_not_a_number": (
        '<mass value="6.0"/>',
        '<mass value="nan"/>',
        "link 'link_3' mass is 'nan': it must be a finite number",
    ),
    "mass_missing": (
        '<mass value="6.0"/>',
        "",
        "link 'link_3' mass is missing: it must be a number",
    ),
    "massless_with_inertia": (
        '<mass value="6.0"/>',
        '<mass value="0"/>',
        "link 'link_3' mass is 0.0: it must be positive: the link has an inertia",
    ),
    "massless_and_moving": (
        f'<mass value="6.0"/>\n      <inertia {LINK_3_INERTIA}/>',
        '<mass value="0"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>',
        "link 'link_3' mass is 0.0: a link that moves must have mass, its own or of links fixed",
    ),
    "inertia_entry_missing": (
        'ixx="1.1304" iyy="1.1304" izz="0.0108"',
        'ixx="1.1304" izz="0.0108"',
        "link 'link_3' inertia iyy is missing: it must be a number",
    ),
    "inertia_negative": (
        'izz="0.0108"',
        'izz="-0.0108"',
        "link 'link_3' inertia is of principal moments -0.0108, 1.1304, 1.1304: all three must",
    ),
    "inertia_not_positive_definite": (
        'izz="0.0108" ixy="0.0"',
        'izz="0.0108" ixy="1.2"',
        "link 'link_3' inertia is of principal moments -0.0696, 0.0108, 2.3304: all three must",
    ),
    "triangle_inequality": (
        'izz="0.0108"',
        'izz="2.3"',
        "link 'link_3' inertia is of principal moments 1.1304, 1.1304, 2.3: the largest must not",
    ),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_a_urdf_with_a_fault_is_refused_by_the_name_of_what_is_at_fault(name: str) -> None:
    found, instead, message = REFUSALS[name]
    assert found in LEMUR
    faulty = LEMUR.replace(found, instead, 1)
    with pytest.raises(InvalidInput) as refusal:
        checked_urdf(faulty, "chaser", "end_effector")
    assert refusal.value.status is Status.BAD_ROBOT
    told = str(refusal.value)
    if told.startswith("robot.urdf is at fault in "):  # what follows from the fault is told, too
        told = told.partition("places: ")[2]
    assert told.startswith(message)


@pytest.mark.parametrize(
    ("base", "tip", "message"),
    [
        (
            "",
            "end_effector",
            "robot.base_link is empty: it must be one of the URDF's links: chaser",
        ),
        ("chaser", "", "robot.tip_link is empty: it must be one of the URDF's links: chaser, end_"),
        ("body", "end_effector", "robot.base_link is body: it must be one of the URDF's links: c"),
        ("chaser", "hand", "robot.tip_link is hand: it must be one of the URDF's links: chaser, "),
        (
            "chaser",
            "chaser",
            "robot.tip_link is chaser: it is the base link, and a robot has joints ",
        ),
        ("link_3", "link_1", "robot.tip_link is link_1: it must hang on the base link 'link_3'"),
        ("link_1", "end_effector", "joint 'joint_1' is movable and carries the base link: make it"),
    ],
)
def test_links_that_do_not_hold_the_arm_are_refused(base: str, tip: str, message: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        checked_urdf(LEMUR, base, tip)
    assert refusal.value.status is Status.BAD_ROBOT
    assert str(refusal.value).startswith(message)


@pytest.mark.parametrize("joints", [1, 2, 5])
def test_an_arm_may_have_any_number_of_joints_but_none(joints: int) -> None:
    urdf = random_urdf(joints=max(joints, 3), seed=0)
    names = [f"joint_{k + 1}" for k in range(max(joints, 3))]
    held = dict.fromkeys(names[joints:], 0.0)
    robot = robot_from_urdf_text(urdf, "bus", "tool", held_at=held)
    assert robot.joint_names == tuple(names[:joints])
    with pytest.raises(InvalidInput, match=r"joints from base to tip is 0: at least one must turn"):
        checked_urdf(urdf, "bus", "tool", dict.fromkeys(names, 0.0))


def test_a_base_without_mass_is_refused_by_link_name() -> None:
    root = ElementTree.fromstring(LEMUR)
    chaser = root.find("link[@name='chaser']")
    chaser.remove(chaser.find("inertial"))
    with pytest.raises(InvalidInput, match=r"link 'chaser' mass is 0\.0"):
        checked_urdf(ElementTree.tostring(root, encoding="unicode"), "chaser", "end_effector")


def test_a_moving_link_may_have_its_mass_in_a_link_fixed_to_it() -> None:
    moved = LEMUR.replace('<link name="link_7">', '<link name="link_7"/><link name="body_7">')
    moved = moved.replace(
        "</robot>",
        '<joint name="body_7_mount" type="fixed"><parent link="link_7"/><child link="body_7"/>'
        "</joint></robot>",
    )
    robot = robot_from_urdf_text(moved, "chaser", "end_effector")
    assert robot.model.inertias[8].mass == 3.9


def test_a_thin_rod_with_rounded_inertia_passes() -> None:
    rod = LEMUR.replace(LINK_3_INERTIA, LINK_3_INERTIA.replace("0.0108", "1e-7"))
    rod = rod.replace('ixx="1.1304" iyy="1.1304"', 'ixx="1.1304" iyy="1.1304003"')
    checked_urdf(rod, "chaser", "end_effector")


def test_shapes_and_foreign_tags_do_not_matter(capfd: pytest.CaptureFixture[str]) -> None:
    decorated = LEMUR.replace(
        '<link name="end_effector"/>',
        '<link name="end_effector"><visual><geometry><mesh filename="package://gone/a.dae"/>'
        "</geometry></visual><collision><geometry><sphere/></geometry></collision></link>"
        "<transmission/><gazebo><gravity>true</gravity></gazebo><material/>",
    )
    plain = robot_from_urdf_text(LEMUR, "chaser", "end_effector")
    robot = robot_from_urdf_text(decorated, "chaser", "end_effector", geometry=Geometry.LINES)
    assert robot.model == plain.model
    assert capfd.readouterr() == ("", "")


def test_numbers_are_read_once(capfd: pytest.CaptureFixture[str]) -> None:
    # Python reads digits with an underscore; Pinocchio's reader would stop at it.
    written = LEMUR.replace('effort="80.0"', 'effort="8_0"').replace('"1.5 0.1626', '"1.5_0 0.1626')
    robot = robot_from_urdf_text(written, "chaser", "end_effector")
    assert robot.model == robot_from_urdf_text(LEMUR, "chaser", "end_effector").model
    assert capfd.readouterr() == ("", "")


def test_the_urdf_checked_moves_like_the_urdf_given() -> None:
    given = ElementTree.fromstring(LEMUR)
    checked = ElementTree.fromstring(checked_urdf(LEMUR, "chaser", "end_effector").xml)
    for tag in ("link", "joint"):
        assert [e.get("name") for e in checked.findall(tag)] == [
            e.get("name") for e in given.findall(tag)
        ]
    assert np.isclose(sum(float(e.get("value")) for e in checked.iter("mass")), 375.9)


@pytest.mark.parametrize("file", [LEMUR_URDF, CANADARM2_URDF], ids=lambda file: file.stem)
def test_each_joint_of_a_shipped_robot_lies_in_a_shape_of_a_link_next_to_it(file: Path) -> None:
    """Or, within a wrist whose axes meet in a point, of one that turns about the same point."""
    robot = ElementTree.parse(file).getroot()
    shapes = {link.get("name"): link.findall("visual") for link in robot.iter("link")}
    held = []  # whether the point of the last joint is
    for joint in robot.iter("joint"):
        parent, origin = joint.find("parent").get("link"), joint.find("origin").get("xyz")
        child, here = joint.find("child").get("link"), _numbers(origin)
        near = any(_holds(shape, here) for shape in shapes[parent])
        near |= any(_holds(shape, np.zeros(3)) for shape in shapes[child])
        held.append(near or (bool(held) and held[-1] and not here.any()))
        assert held[-1], joint.get("name")


@pytest.mark.parametrize("file", [LEMUR_URDF, CANADARM2_URDF, TESTBED_URDF], ids=lambda f: f.stem)
def test_a_shipped_robot_is_drawn_as_it_collides(file: Path) -> None:
    def shapes(link: ElementTree.Element, tag: str) -> list[list[bytes]]:
        parts = [[part for part in shape if part.tag != "material"] for shape in link.findall(tag)]
        return [[ElementTree.tostring(part).strip() for part in shape] for shape in parts]

    for link in ElementTree.parse(file).getroot().iter("link"):
        drawn, solid = (shapes(link, tag) for tag in ("visual", "collision"))
        assert drawn == solid, link.get("name")


def _holds(visual: ElementTree.Element, point: np.ndarray) -> bool:
    """Whether a point of the link's frame lies in a shape, surface included."""
    origin, (shape,) = visual.find("origin"), visual.find("geometry")
    place, turn = (_numbers(origin.get(key, "0 0 0")) for key in ("xyz", "rpy"))
    x, y, z = Rotation.from_euler("xyz", turn).inv().apply(point - place)
    if shape.tag == "box":
        half = _numbers(shape.get("size")) / 2
        return bool((np.abs([x, y, z]) <= half + 1e-9).all())
    if shape.tag == "sphere":
        return bool(np.linalg.norm([x, y, z]) <= float(shape.get("radius")) + 1e-9)
    radius, length = float(shape.get("radius")), float(shape.get("length"))
    return bool(np.hypot(x, y) <= radius + 1e-9 and abs(z) <= length / 2 + 1e-9)


def _numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


RESERVED = ("root_joint", "universe", "free_flyer", "world", "random", "bus", "link_1", "tool")


@pytest.mark.parametrize("joint", ["joint_1", "joint_4", "joint_7", "bus_mount", "tool_mount"])
def test_a_joint_may_have_any_name(joint: str) -> None:
    """Masses, joints and motion are the URDF's own, whatever Pinocchio calls its root."""
    given = random_urdf(7, seed=5)
    plain = robot_from_urdf_text(given, "bus", "tool")
    q = pin.neutral(plain.model)
    q[7:] = np.linspace(-0.5, 0.5, 7)
    place, center, mass = seen(plain, q)
    assert mass == pytest.approx(sum_of_masses(given))
    for name in RESERVED:
        xml = given.replace(f'<joint name="{joint}"', f'<joint name="{name}"')
        assert xml != given
        robot = robot_from_urdf_text(xml, "bus", "tool")
        names = [name if old == joint else old for old in plain.joint_names]
        assert list(robot.joint_names) == names
        there, its_center, its_mass = seen(robot, q)
        assert its_mass == pytest.approx(sum_of_masses(xml)), name
        np.testing.assert_allclose(there, place, rtol=0.0, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(its_center, center, rtol=0.0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("link", ["root", "bus", "link_2", "camera", "tool"])
def test_a_link_may_have_the_name_of_a_joint(link: str) -> None:
    given = random_urdf(7, seed=5)
    plain = robot_from_urdf_text(given, "bus", "tool")
    q = pin.neutral(plain.model)
    for name in ("root_joint", "universe", "free_flyer", "joint_3", "bus_mount", "tool_mount"):
        xml = re.sub(rf'((?:link|link name)=)"{link}"', rf'\1"{name}"', given)
        ends = [name if end == link else end for end in ("bus", "tool")]
        robot = robot_from_urdf_text(xml, *ends)
        for found, expected in zip(seen(robot, q), seen(plain, q), strict=True):
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12, err_msg=name)


def sum_of_masses(xml: str) -> float:
    return sum(float(mass.get("value", "")) for mass in ElementTree.fromstring(xml).iter("mass"))


def seen(robot: Robot, q: Array) -> tuple[Array, Array, float]:
    """End effector, centre of mass, total mass."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    center = pin.centerOfMass(robot.model, data, q)
    return tip.homogeneous.copy(), center.copy(), pin.computeTotalMass(robot.model)


def test_a_panel_that_is_fixed_to_the_chaser_is_no_end_effector() -> None:
    panel = (
        '<link name="panel"/><joint name="hinge" type="fixed">'
        '<parent link="chaser"/><child link="panel"/></joint></robot>'
    )
    with_panel = LEMUR.replace("</robot>", panel)
    assert checked_urdf(with_panel).tip_link == "end_effector"
    moving = with_panel.replace('name="hinge" type="fixed"', 'name="hinge" type="floating"')
    with pytest.raises(InvalidInput, match=r"tip_link is not given: it must be one of end_e"):
        checked_urdf(moving)


def test_a_joint_without_an_axis_is_written_as_it_is_read_again() -> None:
    """The text is part of what a plan depends on: it must not change with every reading."""
    text = LEMUR.replace('<axis xyz="0 0 1"/>', "", 1)
    checked = checked_urdf(text).xml
    assert checked_urdf(checked).xml == checked
    assert robot_from_urdf_text(text, geometry=Geometry.LINES).joint_axes[0].tolist() == [1, 0, 0]


def _control(interfaces: str, rest: str = "") -> str:
    joint = f'<joint name="joint_2">{rest}{interfaces}<state_interface name="position"/></joint>'
    return f'<ros2_control name="x" type="system"><hardware/>{joint}</ros2_control></robot>'


def _command(kind: str, **ends: str) -> str:
    params = "".join(f'<param name="{key}">{text}</param>' for key, text in ends.items())
    return f'<command_interface name="{kind}">{params}</command_interface>'


SOFT, CONTROLLED, CONTINUOUS, TORQUES = (
    "stricter limits in <safety_controller>, which are not kept: ",
    "stricter limits in <ros2_control>, which are not kept: ",
    "limits of continuous joints, which are not kept: ",
    "not counted in the torques of joints: ",
)
IN_JOINT_2 = '<child link="link_2"/>'
WIDE = {"min": "-9", "max": "9"}


@pytest.mark.parametrize(
    ("old", "new", "notes"),
    [
        (
            IN_JOINT_2,
            '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="0.25" k_velocity="9"/>',
            [SOFT + "joint_2 position from -0.5 to 0.25 rad"],
        ),
        (
            IN_JOINT_2,
            '<safety_controller soft_upper_limit="1"/>',
            [SOFT + "joint_2 position from -3.14159 to 1 rad"],
        ),
        (IN_JOINT_2, '<safety_controller soft_lower_limit="-4" soft_upper_limit="4"/>', []),
        (IN_JOINT_2, '<safety_controller k_velocity="9"/>', []),
        (IN_JOINT_2, '<safety_controller soft_lower_limit="low"/>', []),
        (
            "</robot>",
            _control(
                _command("position", min="-1.3", max="-0.9") + _command("velocity", max="0.05")
            ),
            [
                CONTROLLED + "joint_2 position from -1.3 to -0.9 rad, "
                "joint_2 velocity from -0.5 to 0.05 rad/s"
            ],
        ),
        (
            "</robot>",
            _control(_command("effort", min="-9", max="9") + _command("acceleration", max="0.1")),
            [
                CONTROLLED + "joint_2 effort from -9 to 9 N m, "
                "joint_2 acceleration from -inf to 0.1 rad/s2"
            ],
        ),
        ("</robot>", _control(_command("position", **WIDE) + _command("current", **WIDE)), []),
        ("</robot>", _control(_command("position", max="1"), '<limits enable="false"/>'), []),
        (
            "</robot>",
            _control(_command("position", max="1")).replace(
                "<param", '<limits enable="false"/><param'
            ),
            [],
        ),
        (IN_JOINT_2, '<dynamics damping="0.0" friction="0"/>', []),
        (
            IN_JOINT_2,
            '<dynamics damping="500" friction="15"/>',
            [TORQUES + "joint_2 damping 500 N m s/rad, friction 15 N m"],
        ),
        (IN_JOINT_2, '<dynamics friction="0.1"/>', [TORQUES + "joint_2 friction 0.1 N m"]),
    ],
)
def test_what_a_urdf_says_of_joints_beside_the_limits_that_are_kept_is_noted(
    old: str, new: str, notes: list[str]
) -> None:
    text = LEMUR.replace(old, new + old if old == IN_JOINT_2 else new, 1)
    assert text != LEMUR
    assert list(checked_urdf(text).notes) == notes
    # What is handed on has none of it.
    plain, found = checked_urdf(LEMUR).xml, checked_urdf(text).xml
    assert found == plain


@pytest.mark.parametrize(
    ("limits", "notes"),
    [
        ('lower="-1" upper="3" ', [CONTINUOUS + "joint_1 position from -1 to 3 rad"]),
        ('lower="0" upper="0" ', []),  # exporters write that
        ('lower="-20" upper="20" ', []),
        ("", []),
    ],
)
def test_position_limits_of_a_continuous_joint_are_noted(limits: str, notes: list[str]) -> None:
    text = LEMUR.replace('"joint_1" type="revolute"', '"joint_1" type="continuous"')
    told = 'lower="-3.141592653589793" upper="3.141592653589793" '
    assert list(checked_urdf(text.replace(told, limits, 1)).notes) == notes


@pytest.mark.parametrize("geometry", Geometry)
@pytest.mark.parametrize("factor", [1e9, 1e6, 1e4])
def test_an_inertia_in_another_unit_is_noted(geometry: Geometry, factor: float) -> None:
    """In g mm2, kg mm2 or kg cm2: of a link of 6 kg, whose radius of gyration is 0.43 m."""
    small, izz = f"{1.1304 * factor!r}", f"{0.0108 * factor!r}"
    wide = LINK_3_INERTIA.replace("1.1304", small).replace("0.0108", izz)
    assert LEMUR.count(LINK_3_INERTIA) == 1
    robot = robot_from_urdf_text(
        LEMUR.replace(LINK_3_INERTIA, wide), "chaser", "end_effector", geometry=geometry
    )
    (note,) = robot.notes
    radius = np.sqrt(1.1304 * factor / 6.0)
    assert note.startswith(f"link 'link_3' has a radius of gyration sqrt(I/m) of {radius:.4g} m, ")
    plain = robot_from_urdf_text(LEMUR, "chaser", "end_effector", geometry=geometry)
    assert plain.notes == ()


def test_an_inertia_in_another_unit_is_noted_of_a_small_link_on_a_heavy_one() -> None:
    """Of a camera of 100 g on a chaser of 350 kg, which is no wider for it."""
    camera = (
        '<link name="camera"><inertial><mass value="0.1"/><inertia ixx="100" iyy="100" izz="100" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="mount" type="fixed">'
        '<parent link="chaser"/><child link="camera"/></joint></robot>'
    )
    robot = robot_from_urdf_text(LEMUR.replace("</robot>", camera), "chaser", "end_effector")
    (note,) = robot.notes
    assert "link 'camera' has a radius of gyration sqrt(I/m) of 31.62 m, by 100 kg m2" in note
