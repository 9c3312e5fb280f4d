"""The momentum-constrained velocity map of Eqs. (27)-(32) at one configuration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.robot.model import Robot


class Velocity(NamedTuple):
    """A tangent velocity and its exact derivatives."""

    v: Array  # base twist in the base frame, joint rates; shape (6 + joints,)
    by_q: Array  # in the tangent space of q; shape (6 + joints, 6 + joints)
    by_twist: Array  # of the end effector, inertial axes; shape (6 + joints, 6)


def velocity(
    robot: Robot,
    q: Array,
    momentum: Array,
    twist_ee_in_inertial: Array,
    bias: Array | None = None,
    damping: float = 0.0,
) -> Velocity | None:
    """Return the velocity of least joint velocities, Eqs. (27) and (31), or nearest to a bias.

    Args:
        q: Configuration. Shape (7 + joints,).
        momentum: Total P and L about the inertial origin, inertial axes. Shape (6,) [N s, N m s].
        twist_ee_in_inertial: Wanted linear and angular velocity. Shape (6,) [m/s, rad/s].
        bias: Joint velocities z; None: zero. Shape (joints,) [rad/s].
        damping: Singular values of the generalised Jacobian up to about this are damped: joint
            velocities stay bounded, and the end effector lags behind. Zero for Eq. (31) itself.

    Returns:
        None in a dynamic singularity, where the arm cannot follow.
    """
    z = np.zeros(robot.joints) if bias is None else bias
    found = compiled.velocity(chain_of(robot), q, momentum, twist_ee_in_inertial, z, damping)
    return None if found is None else Velocity(*found)
