"""The motion of the system at its start, with which every plan begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.planning.paths.polynomial import EndEffectorMotion
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import base_acceleration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import generalised_jacobian, total_momentum
from ff_planner_ros.robot.state import SystemState

# Smaller null-space velocities [rad/s] and accelerations [rad/s2] are rounding: such a start
# follows Eq. (31).
_ROUNDING_RATE, _ROUNDING_ACCELERATION = 1e-11, 1e-9
# The part of a plan in which the null-space motion of its start fades. A shorter one needs more
# torque; in a longer one the joints move further away. Of 24 starts of the lemur with 0.3 rad/s,
# parts of 0.3, 0.5 and 1 left a plan to 21, 22 and 21.
_FADING_PART = 0.5
# No plan changes joint accelerations faster [rad/s3]: one that turns a joint by 1 rad in 2 s
# reaches 8.
FASTEST_CHANGE = 10.0


@dataclass(frozen=True, eq=False)
class NullSpaceFade:
    """Null-space joint velocities z(t) that begin with those of the start and fade smoothly.

    z(t) = z_0 f(u) + d T g(u) z_0', u = t / (d T), where f falls from 1 to 0 and g has slope 1 at
    zero; apart from that, value, slope and curvature of both vanish at either end.
    """

    rates: Array  # z_0; shape (joints,) [rad/s]
    accelerations: Array  # z_0'; shape (joints,) [rad/s2]
    seconds: float  # d T, duration of the fading


@dataclass(frozen=True, eq=False)
class StartMotion:
    """Motion at the first point of a plan."""

    q: Array  # configuration; shape (7 + joints,)
    momentum: Array  # total P and L about the inertial origin; shape (6,)
    end_effector: EndEffectorMotion
    # Motion beyond Eq. (31), as the velocity map's bias z; None: there is none
    null_space: NullSpaceFade | None


def start_motion(robot: Robot, state: SystemState, duration: float) -> StartMotion:
    """Return the motion at the first point of every plan of a duration [s] from a state."""
    model, data, tip = robot.model, robot.model.createData(), robot.tip_frame_id
    q, v = configuration(robot, state)
    momentum = total_momentum(robot, data, q, v)
    known, dv_dt = state.joint_accelerations, np.zeros_like(v)
    if known is not None:
        dv_dt = np.concatenate([base_acceleration(robot, data, q, v, known), known])
    pin.forwardKinematics(model, data, q, v, dv_dt)
    placement = pin.updateFramePlacement(model, data, tip)
    twist = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
    of_ee = pin.getFrameClassicalAcceleration(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
    if known is None:
        of_ee = np.zeros(6)
    jacobian = generalised_jacobian(robot, data, q)
    weights = robot.joint_weights  # as in the velocity map
    inverse = np.linalg.pinv(jacobian / weights) / weights[:, None]
    project = np.eye(robot.joints) - inverse @ jacobian  # N
    z = _without_rounding(project @ state.joint_velocities, _ROUNDING_RATE)
    z_rate = np.zeros(robot.joints)
    solution = None if known is None else velocity(robot, q, momentum, twist, z)
    if solution is not None:
        while_z_stays = solution.by_q[6:] @ v + solution.by_twist[6:] @ of_ee
        z_rate = _without_rounding(project @ (known - while_z_stays), _ROUNDING_ACCELERATION)
    return StartMotion(
        q=q,
        momentum=momentum,
        end_effector=EndEffectorMotion(
            position=placement.translation.copy(),
            rotation_ee_to_inertial=placement.rotation.copy(),
            twist=twist,
            acceleration=of_ee,
        ),
        null_space=NullSpaceFade(z, z_rate, _FADING_PART * duration)
        if z.any() or z_rate.any()
        else None,
    )


def least_highest_positions(
    positions: Array, rates: Array, accelerations: Array, duration: float
) -> Array:
    """Return a lower bound of each joint's highest position in any plan of a duration [s].

    The jerk is at least -`FASTEST_CHANGE`. Shape (..., joints) [rad].
    """
    jerk = FASTEST_CHANGE
    turns = accelerations**2 + 2.0 * jerk * rates
    t = np.where(turns > 0.0, (accelerations + np.sqrt(np.maximum(turns, 0.0))) / jerk, 0.0)
    t = np.clip(t, 0.0, duration)
    way = rates * t + accelerations * t**2 / 2.0 - jerk * t**3 / 6.0
    highest: Array = positions + np.maximum(way, 0.0)
    return highest


def least_highest_rates(rates: Array, accelerations: Array) -> Array:
    """Return a lower bound of each joint's highest velocity in any plan. (joints,) [rad/s]."""
    highest: Array = rates + np.maximum(accelerations, 0.0) ** 2 / (2.0 * FASTEST_CHANGE)
    return highest


def _without_rounding(motion: Array, rounding: float) -> Array:
    return motion if np.abs(motion).max() > rounding else np.zeros_like(motion)
