"""Robots from URDFs."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots import CANADARM2_URDF, LEMUR_URDF, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.robot_page import robot_facts
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.model import Robot, load_robot, robot_from_urdf_text

# The start posture of the paper and the pose that it prints for it.
START_JOINTS_DEG = (12.54, -13.90, 0.0, -64.93, -105.28, 65.61, -127.95)


def ee_pose_at_start(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Position, and Euler angles x, y, z in degrees."""
    data = robot.model.createData()
    q = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *np.deg2rad(START_JOINTS_DEG)])
    pin.framesForwardKinematics(robot.model, data, q)
    placement = data.oMf[robot.tip_frame_id]
    euler_zyx = Rotation.from_matrix(placement.rotation).as_euler("ZYX", degrees=True)
    return placement.translation, euler_zyx[::-1]


def test_the_lemur_starts_in_the_pose_that_the_paper_prints(lemur: Robot) -> None:
    position, euler = ee_pose_at_start(lemur)
    np.testing.assert_allclose(position, [0.8, 0.4, 0.6], atol=1e-4)
    np.testing.assert_allclose(euler, [-45.0, 55.0, -65.0], atol=0.011)


def test_the_lemur_has_the_published_masses(lemur: Robot) -> None:
    assert lemur.model.inertias[1].mass == 350.0
    arm = list(lemur.model.inertias)[2:]
    np.testing.assert_allclose(sum(link.mass for link in arm), 25.9, rtol=1e-14)
    np.testing.assert_array_equal(lemur.model.inertias[1].inertia, np.diag([19.7, 15.7, 26.9]))


def test_joints_and_limits_are_those_of_the_urdf_from_base_to_tip(lemur: Robot) -> None:
    assert lemur.joint_names == tuple(f"joint_{number}" for number in range(1, 8))
    assert lemur.joints == 7
    np.testing.assert_array_equal(lemur.lower_position_limits, np.full(7, -np.pi))
    np.testing.assert_array_equal(lemur.upper_position_limits, np.full(7, np.pi))
    np.testing.assert_array_equal(lemur.velocity_limits, np.full(7, 0.5))
    np.testing.assert_array_equal(lemur.effort_limits, [80.0, 80.0, 80.0, 80.0, 40.0, 40.0, 40.0])


def test_limits_follow_the_chain_and_not_the_order_in_the_file() -> None:
    urdf = CANADARM2_URDF.read_text()
    for number in range(1, 8):
        urdf = urdf.replace('effort="2332"', f'effort="{number}"', 1)
    start, end = urdf.index('<joint name="joint_1"'), urdf.index('<joint name="joint_2"')
    first_joint = urdf[start:end]
    shuffled = urdf.replace(first_joint, "").replace("</robot>", f"{first_joint}</robot>")
    robot = robot_from_urdf_text(shuffled, "station", "end_effector")
    assert robot.joint_names[0] == "joint_1"
    np.testing.assert_array_equal(robot.effort_limits, np.arange(1.0, 8.0))


def test_gravity_is_zero(lemur: Robot) -> None:
    np.testing.assert_array_equal(lemur.model.gravity.vector, np.zeros(6))


def test_an_effort_limit_of_zero_means_that_none_is_known() -> None:
    urdf = LEMUR_URDF.read_text().replace('effort="80.0"', 'effort="0"', 1)
    robot = robot_from_urdf_text(urdf, "chaser", "end_effector")
    np.testing.assert_array_equal(robot.effort_limits[:2], [np.inf, 80.0])


def test_a_continuous_joint_needs_no_limit_and_has_none_then() -> None:
    """As the format says; and so says the text that answers and bags hold."""
    urdf = re.sub(
        r'(<joint name="joint_2") type="revolute"(.*?)<limit [^>]*>',
        r'\1 type="continuous"\2',
        LEMUR_URDF.read_text(),
        flags=re.DOTALL,
    )
    for text in (urdf, robot_from_urdf_text(urdf, "chaser", "end_effector").drawn_urdf):
        robot = robot_from_urdf_text(text, "chaser", "end_effector")
        assert robot.velocity_limits[:3].tolist() == [0.5, np.inf, 0.5]
        assert robot.effort_limits[:3].tolist() == [80.0, np.inf, 80.0]
        assert robot.upper_position_limits[1] == -robot.lower_position_limits[1] == 4.0 * np.pi
    joint = robot_facts(robot)["joints"][1]
    assert joint["type"] == "continuous"
    assert (joint["limits"]["velocity"], joint["limits"]["effort"]) == (None, None)


def test_the_chaser_is_the_base_link_with_all_that_is_fixed_to_it() -> None:
    robot = robot_from_urdf_text(random_urdf(joints=6, seed=6), "bus", "tool")
    assert robot.model.inertias[1].mass == 220.0
    assert np.linalg.norm(robot.position_chaser_in_base) > 0.1
    assert np.linalg.norm(robot.rotation_chaser_to_base - np.eye(3)) > 0.1


def test_a_robot_survives_the_way_to_another_process(lemur: Robot) -> None:
    copy = pickle.loads(pickle.dumps(lemur))
    assert copy.model == lemur.model
    assert copy.joint_names == lemur.joint_names
    np.testing.assert_array_equal(ee_pose_at_start(copy), ee_pose_at_start(lemur))


@pytest.mark.parametrize(
    "name",
    [
        "position_chaser_in_base",
        "rotation_chaser_to_base",
        "lower_position_limits",
        "upper_position_limits",
        "velocity_limits",
        "effort_limits",
    ],
)
def test_the_arrays_of_a_robot_cannot_be_written_to(lemur: Robot, name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(lemur, name)[0] = 1.0


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"robot\.urdf is .*gone\.urdf: it cannot be read: No"):
        load_robot(tmp_path / "gone.urdf", "chaser", "end_effector")


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    urdf = tmp_path / "binary.urdf"
    urdf.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidInput, match=r"binary\.urdf: it is not UTF-8"):
        load_robot(urdf, "chaser", "end_effector")


def test_a_faulty_urdf_is_refused(tmp_path: Path) -> None:
    urdf = tmp_path / "empty.urdf"
    urdf.write_text("<robot/>")
    with pytest.raises(InvalidInput) as refusal:
        load_robot(urdf, "chaser", "end_effector")
    assert refusal.value.status is Status.BAD_ROBOT
