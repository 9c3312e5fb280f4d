"""Chaser state to Pinocchio configuration and back.

Pinocchio's free-flyer is at the root of the URDF; a state describes the chaser frame, whose origin
is the chaser's centre of mass. Both are fixed to the same body.

A configuration q, shape (7 + joints,), holds base position, quaternion xyzw and joint positions; a
tangent velocity v, shape (6 + joints,), holds the base twist in the base frame and joint
velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.urdf import TURN_OF_CONTINUOUS

# Most turns that a continuous joint may have counted: beyond, its angle loses digits.
_MOST_TURNS = 1e4
_TURN = 2.0 * np.pi


def eigen_quaternion(rotation: Array) -> Array:
    """Return the unit quaternion of one rotation matrix, with the sign that Eigen gives it.

    `pin.Quaternion(rotation)` would be the same, and its 80 bytes would never be freed.
    """
    quaternion: Array = pin.SE3ToXYZQUAT(pin.SE3(rotation, np.zeros(3)))[3:]
    return quaternion


@lru_cache(maxsize=8)  # a search asks for those of its start again and again
def configuration(robot: Robot, state: SystemState) -> tuple[Array, Array]:
    """Return the Pinocchio configuration and tangent velocity of a state, both read-only."""
    rotation_chaser_to_inertial = pin.Quaternion(
        state.quaternion_chaser_to_inertial_xyzw
    ).toRotationMatrix()
    rotation_base_to_inertial = rotation_chaser_to_inertial @ robot.rotation_chaser_to_base.T
    base_from_chaser = -rotation_base_to_inertial @ robot.position_chaser_in_base
    omega = state.angular_velocity_chaser_in_inertial
    velocity_base = state.linear_velocity_chaser_in_inertial + pin.skew(omega) @ base_from_chaser
    q = np.concatenate(
        [
            state.position_chaser_in_inertial + base_from_chaser,
            eigen_quaternion(rotation_base_to_inertial),
            state.joint_positions,
        ]
    )
    v = np.concatenate(
        [
            rotation_base_to_inertial.T @ velocity_base,
            rotation_base_to_inertial.T @ omega,
            state.joint_velocities,
        ]
    )
    return frozen(q), frozen(v)


def system_state(robot: Robot, q: Array, v: Array) -> SystemState:
    """Return the state of a Pinocchio configuration and tangent velocity."""
    rotation_base_to_inertial = pin.Quaternion(q[3:7]).toRotationMatrix()
    chaser_from_base = rotation_base_to_inertial @ robot.position_chaser_in_base
    omega = rotation_base_to_inertial @ v[3:6]
    return SystemState(
        position_chaser_in_inertial=q[:3] + chaser_from_base,
        quaternion_chaser_to_inertial_xyzw=eigen_quaternion(
            rotation_base_to_inertial @ robot.rotation_chaser_to_base
        ),
        linear_velocity_chaser_in_inertial=rotation_base_to_inertial @ v[:3]
        + pin.skew(omega) @ chaser_from_base,
        angular_velocity_chaser_in_inertial=omega,
        joint_positions=q[7:],
        joint_velocities=v[6:],
    )


def about(robot: Robot, joint_positions: Array) -> Robot:
    """Return the robot with the bounds of continuous joints about the turn that they are in.

    Postures a turn apart are one: a plan from either is the same motion.
    """
    counted = np.clip(np.rint(joint_positions / _TURN), -_MOST_TURNS, _MOST_TURNS)
    turns = np.where(robot.continuous, counted, 0.0)
    return robot if (turns == turns_of(robot)).all() else _about(robot, tuple(turns.tolist()))


def turns_of(robot: Robot) -> Array:
    """Return the turn that the bounds of each continuous joint are about; zero of others."""
    middle = (robot.lower_position_limits + robot.upper_position_limits) / 2.0
    return np.where(robot.continuous, np.rint(middle / _TURN), 0.0)


def whole_turns(way: Array) -> Array:
    """Return the whole turns in the ways of joints that turn [rad]; zero where not finite."""
    return np.where(np.isfinite(way), _TURN * np.rint(way / _TURN), 0.0)


def without_turns(way: Array, continuous: Sequence[bool] | bool) -> Array:
    """Return ways of joints without whole turns of those that are continuous [rad, m]."""
    return way - np.where(continuous, whole_turns(way), 0.0)


def whose_limits(robot: Robot, joint: int) -> str:
    """Return what to add to position limits in a message that are not those of the URDF."""
    if not robot.continuous[joint]:
        return ""
    return ", the planner's: the joint is continuous, and may do two turns either way of the start"


@lru_cache(maxsize=8)  # other caches know a robot by its identity
def _about(robot: Robot, turns: Sequence[float]) -> Robot:
    middle = _TURN * np.array(turns)
    lower, upper = middle - TURN_OF_CONTINUOUS, middle + TURN_OF_CONTINUOUS
    return replace(
        robot,
        lower_position_limits=frozen(
            np.where(robot.continuous, lower, robot.lower_position_limits)
        ),
        upper_position_limits=frozen(
            np.where(robot.continuous, upper, robot.upper_position_limits)
        ),
    )
