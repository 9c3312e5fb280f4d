"""What counts is the body: grippers are held, and links fixed to others may be careless."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from robots import LEMUR_URDF

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.simulation.engine import Engine

LEMUR = LEMUR_URDF.read_text()
JOINTS = np.linspace(-0.8, 0.9, 7)
ZERO = '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'


def with_parts(*parts: str) -> str:
    return LEMUR.replace("</robot>", f"{''.join(parts)}</robot>")


def link(name: str, mass: float, inertia: str) -> str:
    inertial = f'<origin xyz="0.1 -0.2 0.3" rpy="0.3 0 1"/><mass value="{mass}"/>{inertia}'
    return f'<link name="{name}"><inertial>{inertial}</inertial></link>'


def body(name: str) -> str:
    return link(name, 0.7, '<inertia ixx=".02" iyy=".03" izz=".04" ixy=".001" ixz="0" iyz="0"/>')


def joint(name: str, kind: str, parent: str, child: str, rest: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0.1 0.2 -0.1" rpy="0.4 -0.3 0.2"/>'
        f'<parent link="{parent}"/><child link="{child}"/>{rest}</joint>'
    )


# A slide that cannot stand at zero, its mimic, a finger that turns and cannot be straight, and a
# wheel on it.
GRIPPER = with_parts(
    body("palm"),
    joint("palm_mount", "fixed", "link_7", "palm"),
    body("slide"),
    joint("slide_joint", "prismatic", "palm", "slide",
          '<axis xyz="0 2 1"/><limit lower="0.01" upper="0.04" velocity="1" effort="1"/>'),
    body("other_slide"),
    joint("other_slide_joint", "prismatic", "palm", "other_slide",
          '<axis xyz="0 -1 0"/><mimic joint="slide_joint"/>'
          '<limit lower="0" upper="0.04" velocity="1" effort="1"/>'),
    body("finger"),
    joint("finger_joint", "revolute", "end_effector", "finger",
          '<axis xyz="1 1 0"/><limit lower="-2" upper="-0.3" velocity="1" effort="1"/>'),
    body("wheel"),
    joint("wheel_joint", "continuous", "finger", "wheel", '<axis xyz="0 0 1"/>'),
)  # fmt: skip
HELD_AT = {"slide_joint": 0.01, "other_slide_joint": 0.01, "finger_joint": -0.3}


def test_a_gripper_is_held_where_its_limits_allow_and_weighs_what_it_weighs() -> None:
    robot = robot_from_urdf_text(GRIPPER, "chaser", "end_effector")
    assert robot.joint_names == tuple(f"joint_{number}" for number in range(1, 8))
    (note,) = robot.notes
    for name, at in (*HELD_AT.items(), ("wheel_joint", 0.0)):
        assert f"{name} at {at:g}" in note
    for found, expected in zip(seen(robot), seen_by_pinocchio(GRIPPER, HELD_AT), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_the_urdf_of_a_robot_with_a_gripper_is_that_robot() -> None:
    robot = robot_from_urdf_text(GRIPPER, "chaser", "end_effector")
    again = robot_from_urdf_text(robot.urdf, "chaser", "end_effector")
    assert again.urdf == robot.urdf
    assert again.model == robot.model
    assert again.notes == ()


@pytest.mark.parametrize("carrier", ["chaser", "link_4", "end_effector"])
@pytest.mark.parametrize("inertia", ["", ZERO], ids=["without", "zero"])
def test_a_link_fixed_to_another_may_be_a_mass_point(carrier: str, inertia: str) -> None:
    beside = (
        joint("mount", "fixed", carrier, "sensor"),
        body("box"),
        joint("box_mount", "fixed", "sensor", "box"),
    )
    given = with_parts(link("sensor", 3.0, inertia), *beside)
    robot = robot_from_urdf_text(given, "chaser", "end_effector")
    expected = seen_by_pinocchio(with_parts(link("sensor", 3.0, ZERO), *beside), {})
    for found, other in zip(seen(robot), expected, strict=True):
        np.testing.assert_allclose(found, other, rtol=1e-12, atol=1e-12)
    mass = pin.computeTotalMass(robot.model)
    assert Engine(robot).mass == pytest.approx(mass, rel=1e-12)


def test_a_body_of_points_alone_is_refused_by_its_link() -> None:
    points = LEMUR.replace('<link name="link_5">', '<link name="link_5"/><link name="old">')
    points = points.replace("</robot>", link("point", 1.0, ZERO) + "</robot>")
    at_link_5 = joint("mount", "fixed", "link_5", "point")
    points = points.replace("</robot>", at_link_5 + "</robot>")
    robot = ElementTree.fromstring(points)
    robot.remove(robot.find("link[@name='old']"))
    with pytest.raises(InvalidInput, match=r"link 'link_5' inertia is of principal moments .*0,"):
        robot_from_urdf_text(ElementTree.tostring(robot, "unicode"), "chaser", "end_effector")


def test_careless_inertia_of_a_small_fixed_link_counts_as_written_with_a_note() -> None:
    moments = 'ixx="0.001" iyy="0.001" izz="0.01"'
    sensor = link("sensor", 0.1, f'<inertia {moments} ixy="0" ixz="0" iyz="0"/>')
    text = with_parts(sensor, joint("mount", "fixed", "chaser", "sensor"))
    robot = robot_from_urdf_text(text, "chaser", "end_effector")
    (note,) = robot.notes
    assert note.startswith("link 'sensor' inertia is of principal moments 0.001, 0.001, 0.01, ")
    for found, expected in zip(seen(robot), seen_by_pinocchio(text, {}), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    Engine(robot)  # takes what MuJoCo would refuse in a link of its own
    on_its_own = text.replace('ixx="0.0106" iyy="0.0106" izz="0.0045"', moments)
    with pytest.raises(InvalidInput, match=r"link 'link_1' inertia is of principal moments 0.001"):
        robot_from_urdf_text(on_its_own, "chaser", "end_effector")


def test_a_fixed_joint_needs_no_axis_and_no_limits_that_make_sense() -> None:
    odd = LEMUR.replace(
        "</robot>",
        '<link name="lamp"/>'
        + joint("odd", "fixed", "chaser", "lamp", '<axis xyz="x"/><limit lower="nan"/>')
        + "</robot>",
    )
    plain = robot_from_urdf_text(LEMUR, "chaser", "end_effector")
    robot = robot_from_urdf_text(odd, "chaser", "end_effector")
    assert list(robot.model.inertias) == list(plain.model.inertias)
    assert robot.notes == ()


def seen(robot: Robot) -> tuple[Array, Array, Array, float]:
    """End effector, centre of mass, inertia of the whole about it, and mass, in one posture."""
    return seen_in(robot.model, dict(zip(robot.joint_names, JOINTS, strict=True)))


def seen_by_pinocchio(urdf: str, gripper: dict[str, float]) -> tuple[Array, Array, Array, float]:
    """See the same of the URDF as it is given, with all its joints."""
    arm = {f"joint_{number}": angle for number, angle in enumerate(JOINTS, start=1)}
    return seen_in(pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer()), arm | gripper)


def seen_in(model: pin.Model, angles: dict[str, float]) -> tuple[Array, Array, Array, float]:
    data, q = model.createData(), pin.neutral(model)
    for name, angle in angles.items():
        q[model.idx_qs[model.getJointId(name)]] = angle
    pin.ccrba(model, data, q, np.zeros(model.nv))
    pin.framesForwardKinematics(model, data, q)
    tip = data.oMf[model.getFrameId("end_effector", pin.FrameType.BODY)]
    center = pin.centerOfMass(model, data, q).copy()
    return tip.homogeneous, center, data.Ig.inertia.copy(), pin.computeTotalMass(model)
