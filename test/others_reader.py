"""Pinocchio's own reader of URDFs, to compare with ours: masses, inertias and places of the tip."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot

CLOSE = 1e-12
NOTHING: Mapping[str, tuple[str, float, float]] = {}


def require_same(
    robot: Robot,
    text: str,
    locked: Mapping[str, float],
    postures: int = 20,
    coupled: Mapping[str, tuple[str, float, float]] = NOTHING,
) -> None:
    """Require that each part that moves, and the tip at random postures, are as Pinocchio reads.

    Args:
        text: The URDF that the robot was read from.
        locked: Positions of joints that do not move [rad, m]; those that are left out are at zero.
        coupled: Of joints that move along with another one: that, multiplier and offset.
    """
    theirs = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    data, q = theirs.createData(), pin.neutral(theirs)
    for name, at in locked.items():
        put(theirs, q, name, at)
    pin.forwardKinematics(theirs, data, q)
    moving = [theirs.getJointId(name) for name in tuple(robot.model.names)[2:]]
    assert len(moving) == robot.joints + len(coupled)
    weights = {joint: pin.Inertia.Zero() for joint in (1, *moving)}
    for joint in range(1, theirs.njoints):
        carrier = joint
        while carrier not in weights:
            carrier = theirs.parents[carrier]
        in_carrier = data.oMi[carrier].actInv(data.oMi[joint])
        weights[carrier] += in_carrier.act(theirs.inertias[joint])
    for ours, weight in zip(list(robot.model.inertias)[1:], weights.values(), strict=True):
        np.testing.assert_allclose(ours.mass, weight.mass, rtol=CLOSE)
        # As what each entry is made of: by a lever of a metre, kg m2 are as many kg.
        np.testing.assert_allclose(ours.lever, weight.lever, atol=CLOSE)
        largest = np.abs(weight.inertia).max() + weight.mass
        np.testing.assert_allclose(ours.inertia, weight.inertia, atol=CLOSE * largest)
    tip = theirs.getFrameId(robot.tip_link, pin.FrameType.BODY)
    rng, our_data = np.random.default_rng(5), robot.model.createData()
    for _ in range(postures):
        joints = rng.uniform(robot.lower_position_limits, robot.upper_position_limits)
        turned = pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()
        ours = np.concatenate([rng.normal(size=3), turned, joints])
        q[:7] = ours[:7]
        at = dict(zip(robot.joint_names, joints.tolist(), strict=True))
        at |= {name: times * at[of] + more for name, (of, times, more) in coupled.items()}
        for name, position in at.items():
            put(theirs, q, name, position)
        pin.forwardKinematics(robot.model, our_data, ours)
        pin.forwardKinematics(theirs, data, q)
        place = pin.updateFramePlacement(robot.model, our_data, robot.tip_frame_id).homogeneous
        wanted = pin.updateFramePlacement(theirs, data, tip).homogeneous
        np.testing.assert_allclose(place, wanted, atol=CLOSE * np.abs(wanted).max())


def put(model: pin.Model, q: Array, name: str, at: float) -> None:
    """Write the position of a joint; a continuous one has two numbers there."""
    joint = model.joints[model.getJointId(name)]
    q[joint.idx_q : joint.idx_q + joint.nq] = at if joint.nq == 1 else [np.cos(at), np.sin(at)]
