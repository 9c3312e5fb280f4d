"""The frame in which a plan that a controller follows is looked at: the system's centre of mass."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from robots import LEMUR_URDF, random_state, random_urdf

from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.motion import to_trajectory
from ff_planner_ros.planning.robust.base_spread import tracked_motion
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "urdf",
    [(random_urdf(4, 1), "bus", "tool"), (LEMUR_URDF.read_text(), "chaser", "end_effector")],
    ids=["four joints", "lemur"],
)
def test_it_begins_in_the_centre_of_mass_and_moves_with_it(
    urdf: tuple[str, str, str], seed: int
) -> None:
    """There the system has no linear momentum, and every configuration is where the plan has it."""
    robot, rng = robot_from_urdf_text(*urdf), np.random.default_rng(seed)
    q, v = configuration(robot, random_state(robot, rng))
    data, count = robot.model.createData(), 6
    momentum = total_momentum(robot, data, q, v)
    ways = np.vstack([q[7:], q[7:] + 0.2 * rng.normal(size=(count - 1, robot.joints))])
    rates = np.vstack([v[6:], 0.1 * rng.normal(size=(count - 1, robot.joints))])
    joints = JointMotion(np.linspace(0.0, 3.0, count), ways, rates, np.zeros_like(rates))
    fine = driven(robot, q, momentum, joints, np.linspace(0.0, 3.0, 40 * (count - 1) + 1))
    plan = to_trajectory(robot, joints.time, *(rows[::40] for rows in fine))
    pin.centerOfMass(robot.model, data, q, v)
    center, drift = data.com[0].copy(), data.vcom[0].copy()
    motion = tracked_motion(robot, plan)
    assert motion.origin == pytest.approx(center, abs=1e-9)
    assert motion.velocity == pytest.approx(drift, abs=1e-9)
    assert motion.momentum[:3] == pytest.approx(np.zeros(3), abs=1e-9)
    about_center = momentum[3:] - np.cross(center, momentum[:3])
    assert motion.momentum[3:] == pytest.approx(about_center, abs=1e-8)
    for here in motion.q:
        assert pin.centerOfMass(robot.model, data, here) == pytest.approx(np.zeros(3), abs=1e-8)
    seen = motion.q[motion.at_points]
    assert motion.time[motion.at_points] == pytest.approx(joints.time, abs=1e-12)
    expected = plan.chaser_positions - center - np.outer(joints.time, drift)
    chaser = [
        at[:3] + pin.Quaternion(at[3:7]).toRotationMatrix() @ robot.position_chaser_in_base
        for at in seen
    ]
    assert np.array(chaser) == pytest.approx(expected, abs=1e-6)
