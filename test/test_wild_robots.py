"""URDFs that others wrote: the arms and robots of PyPI's `example-robot-data`."""

from __future__ import annotations

import itertools
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest
from others_reader import require_same

from ff_planner_ros import cli
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem, Target
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import generalised_jacobian
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.verification import verify

pytestmark = pytest.mark.ci

LINES = Geometry.LINES


class Arm(NamedTuple):
    urdf: str  # below `robots`
    tip_link: str
    joints: int
    held: tuple[str, ...] = ()  # of the gripper


ARMS = {
    "ur5": Arm("ur_description/urdf/ur5_robot.urdf", "ee_link", 6),
    "ur10": Arm("ur_description/urdf/ur10_robot.urdf", "tool0", 6),
    "panda": Arm(
        "panda_description/urdf/panda.urdf",
        "panda_hand_tcp",
        7,
        ("panda_finger_joint1", "panda_finger_joint2"),
    ),
    "xarm7": Arm("xarm_description/urdf/xarm7.urdf", "link_eef", 7),
    "talos_left": Arm(
        "talos_data/robots/talos_left_arm.urdf",
        "gripper_left_base_link",
        6,
        ("gripper_left_joint",),
    ),
    "z1": Arm("z1_description/urdf/z1.urdf", "link06", 6, ("jointGripper",)),
}


# With these: two arms, wheels, legs, hands, and arms under a flying platform.
READ = [
    *((arm.urdf, arm.tip_link) for arm in ARMS.values()),
    ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_rubber_hand"),
    ("hextilt_description/urdf/hextilt_flying_arm_5.urdf", "flying_arm_5__gripper"),
    ("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    ("talos_data/robots/talos_full_v2.urdf", "gripper_left_base_link"),
    ("tiago_description/robots/tiago_dual.urdf", "arm_left_tool_link"),
]


def robots_of_others() -> Path:
    """Return where their URDFs are; a test that needs them is skipped where they are not."""
    try:
        installed = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("needs the robots of others: pip install '.[robots]'")
    return Path(str(installed.locate_file("cmeel.prefix/share/example-robot-data")))


def file_of(urdf: str) -> Path:
    return robots_of_others() / "robots" / urdf


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_as_found_is_shown_with_its_joints_and_all_its_mass(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = ARMS[name]
    assert cli.main(["robot", str(file_of(arm.urdf)), "--tip-link", arm.tip_link]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    text = file_of(arm.urdf).read_text()
    robot = robot_from_urdf_text(text, tip_link=arm.tip_link, geometry=LINES)
    assert robot.joints == arm.joints
    assert all(joint in shown for joint in robot.joint_names)
    assert all(f"{joint} at 0" in shown for joint in arm.held)
    assert ("held, because" in shown) == bool(arm.held)
    masses = (float(mass.get("value", "")) for mass in ElementTree.fromstring(text).iter("mass"))
    assert pin.computeTotalMass(robot.model) == pytest.approx(sum(masses), rel=1e-12)


@pytest.mark.parametrize(("urdf", "tip_link"), READ)
def test_masses_inertias_and_tip_are_as_pinocchio_reads_them(urdf: str, tip_link: str) -> None:
    text = file_of(urdf).read_text()
    robot = robot_from_urdf_text(text, tip_link=tip_link, geometry=LINES)
    locked = {one.name: one.position for one in robot.locked_joints if not one.is_fixed}
    require_same(robot, text, locked)


def test_who_names_no_tip_is_told_which_links_could_be_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["robot", str(file_of(ARMS["ur5"].urdf))]) == 2
    assert "robot.tip_link is not given: it must be one of ee_link, base, tool0" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("urdf", "tip_link", "joints"),
    [
        ("pr2_description/urdf/pr2.urdf", "r_gripper_tool_frame", 8),
        ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector", 6),
        ("talos_data/robots/talos_reduced.urdf", "wrist_left_ft_tool_link", 9),
    ],
)
def test_who_does_what_a_refusal_says_needs_no_second_refusal(
    urdf: str, tip_link: str, joints: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """PR2 needed 29 runs, one for each joint."""
    file = file_of(urdf)
    robot = ElementTree.fromstring(file.read_text())
    if cli.main(["robot", str(file), "--tip-link", tip_link]) != 0:
        told = capsys.readouterr().err
        assert len(told) <= 1000
        for clause, joint in itertools.product(told.split("; "), robot.findall("joint")):
            if f"'{joint.get('name')}'" in clause:
                turns = "make it revolute" in clause
                joint.set("type", "revolute" if turns else "fixed")
                if turns:
                    joint.find("limit").attrib.update(lower="-3", upper="3")
    mended = ElementTree.tostring(robot, encoding="unicode")
    assert robot_from_urdf_text(mended, None, tip_link, geometry=LINES).joints == joints


def test_every_robot_of_the_package_is_shown_or_refused_in_words(
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = sorted((robots_of_others() / "robots").rglob("*.urdf"))
    assert len(files) > 60
    for file in files:
        code = cli.main(["robot", str(file)])
        shown, told = capsys.readouterr()
        assert (code, bool(shown)) in ((0, True), (2, False)), file
        assert len(told) <= 1000, file
        assert code == 0 or told.startswith("ff-planner: "), file


@pytest.mark.parametrize("name", ARMS)
def test_a_capture_with_an_arm_as_found_comes_true(name: str) -> None:
    """On a chaser, from the best of some postures: MuJoCo reads the URDF by itself."""
    arm = ARMS[name]
    text = on_a_chaser(file_of(arm.urdf))
    robot = robot_from_urdf_text(text, "chaser", arm.tip_link, geometry=LINES)
    start = best_posture(robot)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, *configuration(robot, start))
    ee = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    goal = ee * pin.SE3(pin.exp3(np.array([0.1, -0.1, 0.1])), np.array([0.02, 0.03, -0.04]))
    still = np.zeros(3)
    target = Target(goal.translation, pin.Quaternion(goal.rotation).coeffs(), still, still)
    limits = Limits(joint_velocities=True)
    problem = PlanningProblem(robot, start, target, 8.0, 41, (), Objective(1.0, 0.0), limits)
    found = verify(robot, plan(problem, load_parameters().planner).trajectory)
    assert found.passed, (found.deviation, found.momentum_drift)


@pytest.mark.parametrize("name", ARMS)
def test_the_bodies_of_an_arm_as_found_are_the_hulls_of_its_meshes(name: str) -> None:
    """In the places where Pinocchio puts the meshes, which it reads by itself."""
    arm = ARMS[name]
    text, directory = on_a_chaser(file_of(arm.urdf)), file_of(arm.urdf).parent
    robot = robot_from_urdf_text(text, "chaser", arm.tip_link, directory=directory)
    theirs = pin.GeometryModel()
    robots = robots_of_others()
    packages = [str(robots), str(robots.parent)]
    kind = pin.GeometryType.COLLISION
    pin.buildGeomFromUrdfString(robot.model, text, kind, theirs, packages)
    others = {found.name: found for found in theirs.geometryObjects}
    assert len(robot.bodies) == len(others)
    data, rng = robot.model.createData(), np.random.default_rng(7)
    q = pin.neutral(robot.model)
    for _ in range(5):
        q[7:] = rng.uniform(robot.lower_position_limits, robot.upper_position_limits)
        q[:3] = rng.normal(size=3)
        q[3:7] = pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()
        pin.forwardKinematics(robot.model, data, q)
        for body in robot.bodies:
            other = named(others, body.name)
            ours = data.oMi[body.joint] * body.placement_in_joint
            wanted = data.oMi[other.parentJoint] * other.placement
            np.testing.assert_allclose(ours.homogeneous, wanted.homogeneous, rtol=0, atol=1e-12)
    simplified = " ".join(note for note in robot.notes if "simplified" in note)
    for body in robot.bodies:
        mesh = named(others, body.name)
        if isinstance(mesh.geometry, coal.BVHModelBase):
            vertices, corners = mesh.geometry.vertices(), body.solid.points()
            for normal, offset in zip(body.solid.normals(), body.solid.offsets(), strict=True):
                assert (vertices @ normal + offset).max() < 1e-7, body.name
            if Path(mesh.meshPath).name not in simplified:
                known = {row.tobytes() for row in vertices.astype(np.float32)}
                assert known.issuperset(row.tobytes() for row in corners.astype(np.float32))
                np.testing.assert_allclose(np.ptp(corners, axis=0), np.ptp(vertices, axis=0), 1e-6)


def named(others: dict[str, pin.GeometryObject], name: str) -> pin.GeometryObject:
    """What Pinocchio calls `link_0` and `link_1` is `link` and `link#2` of ours."""
    link, _, number = name.partition("#")
    return others[f"{link}_{int(number or 1) - 1}"]


def on_a_chaser(file: Path) -> str:
    """Mount an arm, with what it stands on, on a chaser of 200 kg."""
    robot = ElementTree.parse(file).getroot()
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}
    (root,) = {link.get("name") for link in robot.findall("link")} - children
    chaser = (
        '<link name="chaser"><inertial><mass value="200"/><inertia ixx="40" iyy="40" izz="40" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    mount = (
        '<joint name="mount" type="fixed"><origin xyz="0.1 0 0.5"/><parent link="chaser"/>'
        f'<child link="{root}"/></joint>'
    )
    robot.extend(ElementTree.fromstring(part) for part in (chaser, mount))
    return ElementTree.tostring(robot, encoding="unicode")


def best_posture(robot: Robot) -> SystemState:
    """Return the state at rest, of a hundred, in which the end effector moves most freely."""
    lower, upper = robot.lower_position_limits, robot.upper_position_limits
    third = (upper - lower) / 3
    rng = np.random.default_rng(13)
    data = robot.model.createData()

    def freedom(joints: Array) -> float:
        q, _ = configuration(robot, at_rest(joints))
        return float(np.linalg.svd(generalised_jacobian(robot, data, q), compute_uv=False)[-1])

    return at_rest(max(rng.uniform(lower + third, upper - third, (100, robot.joints)), key=freedom))


def at_rest(joints: Array) -> SystemState:
    still = np.zeros(3)
    return SystemState(still, np.array([0, 0, 0, 1.0]), still, still, joints, np.zeros(len(joints)))
