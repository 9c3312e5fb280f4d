"""Joint rates that hold the end effector still."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import CANADARM2_URDF, LEMUR_URDF, random_state, random_urdf

from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import load_robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum

MOMENTS = ("ixx", "iyy", "izz")
# Section 4.3 of the paper, joints 1 to 7.
PRINTED_RATES_DEG = (0.261, -0.076, -0.071, -1.794, -5.066, -0.416, -0.969)


def test_the_paper_s_start_has_the_joint_rates_that_it_prints(
    lemur_capture: PlanningProblem,
) -> None:
    rates = joint_rates_with_ee_at_rest(lemur_capture.robot, lemur_capture.start)
    np.testing.assert_allclose(np.rad2deg(rates), PRINTED_RATES_DEG, rtol=0.0, atol=0.0013)


@pytest.mark.parametrize(
    ("urdf", "base", "tip"),
    [
        (random_urdf(joints=6, seed=1), "bus", "tool"),
        (random_urdf(joints=9, seed=2), "bus", "tool"),
        (CANADARM2_URDF.read_text(), "station", "end_effector"),
    ],
)
def test_the_velocity_map_at_rest_gives_the_same_rates_and_chaser_twist(
    urdf: str, base: str, tip: str
) -> None:
    robot = robot_from_urdf_text(urdf, base, tip)
    for seed in range(5):
        state = random_state(robot, np.random.default_rng(seed))
        rates = joint_rates_with_ee_at_rest(robot, state)
        q, v = configuration(robot, replace(state, joint_velocities=rates))
        momentum = total_momentum(robot, robot.model.createData(), q, v)
        at_rest = velocity(robot, q, momentum, np.zeros(6))
        np.testing.assert_allclose(at_rest.v, v, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("part", ["linear", "angular"])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [0.02, -0.02])
def test_while_the_chaser_drifts_or_turns_about_one_axis_alone_the_end_effector_rests(
    part: str, axis: int, side: float, lemur_capture: PlanningProblem
) -> None:
    """The end effector's place by differences: it stays, and its attitude does."""
    robot, still = lemur_capture.robot, np.zeros(3)
    moving = {
        "linear_velocity_chaser_in_inertial": still,
        "angular_velocity_chaser_in_inertial": still,
        f"{part}_velocity_chaser_in_inertial": side * np.eye(3)[axis],
    }
    state = replace(lemur_capture.start, **moving)
    rates = joint_rates_with_ee_at_rest(robot, state)
    assert np.abs(rates).max() > 1e-3
    q, v = configuration(robot, replace(state, joint_velocities=rates))
    data, places = robot.model.createData(), []
    for time in (-1e-4, 1e-4):
        pin.forwardKinematics(robot.model, data, pin.integrate(robot.model, q, time * v))
        places.append(pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).copy())
    assert np.abs(pin.log6(places[0].actInv(places[1])).vector).max() < 1e-9


def test_a_singular_posture_is_refused(lemur_capture: PlanningProblem) -> None:
    # Elbow stretched, wrist axes in line.
    stretched = np.array([0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0])
    with pytest.raises(InvalidInput, match=r"joints\.position is \[.*in this posture") as refusal:
        joint_rates_with_ee_at_rest(
            lemur_capture.robot, replace(lemur_capture.start, joint_positions=stretched)
        )
    assert refusal.value.status is Status.START_SINGULAR


def test_a_chaser_that_is_too_light_is_told_from_a_singular_posture() -> None:
    six = LEMUR_URDF.read_text().replace('"joint_3" type="revolute"', '"joint_3" type="fixed"')
    root = ElementTree.fromstring(six)
    for name, moment in (("mass", {"value": "1e-6"}), ("inertia", dict.fromkeys(MOMENTS, "1e-10"))):
        part = root.find(f"link[@name='chaser']/inertial/{name}")
        assert part is not None
        part.attrib.update(moment)
    light, usual = (
        robot_from_urdf_text(text, "chaser", "end_effector")
        for text in (ElementTree.tostring(root, encoding="unicode"), six)
    )
    state = random_state(light, np.random.default_rng(0))
    assert joint_rates_with_ee_at_rest(usual, state).any()
    with pytest.raises(InvalidInput, match="the chaser, 1e-06 kg, is too light for the arm"):
        joint_rates_with_ee_at_rest(light, state)


def test_an_arm_with_too_few_joints_cannot_rest() -> None:
    names = [f"joint_{k}" for k in range(4, 8)]
    robot = load_robot(LEMUR_URDF, "chaser", "end_effector", held_at=dict.fromkeys(names, 0.0))
    state = random_state(robot, np.random.default_rng(0))
    with pytest.raises(InvalidInput, match=r"to rest is 6 conditions, the arm has 3 joints"):
        joint_rates_with_ee_at_rest(robot, state)


def test_while_the_chaser_is_at_rest_so_is_any_arm_in_any_posture() -> None:
    names = [f"joint_{k}" for k in range(4, 8)]
    for held in ({}, dict.fromkeys(names, 0.0)):
        robot = load_robot(LEMUR_URDF, "chaser", "end_effector", held_at=held)
        drifting = random_state(robot, np.random.default_rng(0))
        still = replace(
            drifting,
            linear_velocity_chaser_in_inertial=np.zeros(3),
            angular_velocity_chaser_in_inertial=np.zeros(3),
            joint_positions=np.zeros(robot.joints),  # stretched
        )
        assert not joint_rates_with_ee_at_rest(robot, still).any()
