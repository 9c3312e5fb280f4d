"""The joint velocities that hold the end effector at rest while the chaser drifts."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import generalised_jacobian
from ff_planner_ros.robot.state import SystemState

# Largest condition number of the linear system for y; beyond it the arm is singular.
MAX_CONDITION = 1e8


def was_asked_to_rest(robot: Robot, state: SystemState) -> bool:
    """Tell whether a file asked for the joint velocities of a state by an end effector at rest.

    A state that was changed since then has others.
    """
    if not state.ee_at_rest:
        return False
    try:
        return np.array_equal(joint_rates_with_ee_at_rest(robot, state), state.joint_velocities)
    except InvalidInput:
        return False


def joint_rates_with_ee_at_rest(robot: Robot, state: SystemState) -> Array:
    """Return the joint velocities of Eq. (31) that hold the end effector at rest [rad/s, m/s].

    Rest means J_ch w_ch + J_m theta_dot = 0. Of these velocities, those of Eq. (31) lie in the row
    space of J_D, theta_dot = J_D^T y, so that (J_m J_D^T) y = -J_ch w_ch; no iteration over
    the momentum, which depends on theta_dot, is needed.

    The joint velocities of the state do not matter. If the chaser is at rest, they are zero for any
    arm in any posture.

    Raises:
        InvalidInput: The chaser moves, and the arm is in a singular posture, is too heavy beside
            the chaser, or has too few joints.
    """
    rows, of_tip = robot.base.rows, robot.base.tip_rows
    data = robot.model.createData()
    q, v = configuration(robot, state)
    if not v[rows].any():
        return np.zeros(robot.joints)
    if robot.joints < len(of_tip):
        raise InvalidInput(
            Status.UNSUPPORTED,
            "joints.end_effector_at_rest",
            "true",
            f"to rest is {len(of_tip)} conditions, the arm has {robot.joints} "
            f"joint{'s' if robot.joints != 1 else ''}; give joints.velocity",
        )
    row_space = generalised_jacobian(robot, data, q).T
    pin.computeJointJacobians(robot.model, data, q)
    jacobian = pin.getFrameJacobian(robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    jacobian = jacobian[of_tip]
    rates_to_twist = jacobian[:, 6:] @ row_space
    condition = np.linalg.cond(rates_to_twist)
    if not condition < MAX_CONDITION:
        arm, why = jacobian[:, 6:], "in this posture no joint rates hold the end effector at rest"
        if np.linalg.cond(arm @ arm.T) < MAX_CONDITION:
            chaser, *links = (link.mass for link in robot.model.inertias[1:])
            why = (
                f"the chaser, {chaser:g} kg, is too light for the arm, {sum(links):.4g} kg, to "
                "rest its end effector: on a base that stands still it could in this posture"
            )
        raise InvalidInput(
            Status.START_SINGULAR,
            "joints.position",
            np.array2string(state.joint_positions, precision=4),
            why,
        )
    rates: Array = row_space @ np.linalg.solve(rates_to_twist, -jacobian[:, rows] @ v[rows])
    return rates
