"""The momentum regressor: momentum is linear in the inertial parameters.

The parameters of a body are Pinocchio's ten: mass, mass times centre of mass, and the inertia about
the origin of the body's frame (xx, xy, yy, xz, yz, zz). Bodies are the chaser and the links that
each joint moves, links that are fixed to each other being one body.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import skew

PARAMETERS = 10  # of a body


def inertial_parameters(robot: Robot) -> Array:
    """Return the parameters of all bodies, from the chaser to the tip. Shape (10 * bodies,)."""
    bodies = list(robot.model.inertias)[1:]
    return np.concatenate([body.toDynamicParameters() for body in bodies])


def momentum_regressors(robot: Robot, positions: Array, rates: Array) -> Array:
    """Return the matrices Y from inertial parameters phi to momentum, in the base frame.

    The momentum about the base frame's origin, in its axes, at base twist xi is
    (sum_k xi_k Y_k + Y_6) phi: Y_0 to Y_5 belong to the base's unit twists, the joints at rest, and
    Y_6 to the joint velocities, the base at rest.

    Args:
        positions: Shape (times, joints) [rad, m].
        rates: Shape (times, joints) [rad/s, m/s].

    Returns:
        Shape (times, 7, 6, 10 * bodies).
    """
    times, bodies = len(positions), robot.joints + 1
    turns, places = np.empty((times, bodies, 3, 3)), np.empty((times, bodies, 3))
    twists = np.empty((times, bodies, 7, 6))  # of the bodies, in their own axes
    data = robot.model.createData()
    q, v = pin.neutral(robot.model), np.zeros(robot.model.nv)
    for i in range(times):
        q[7:], v[6:] = positions[i], rates[i]
        pin.forwardKinematics(robot.model, data, q, v)
        for k in range(bodies):
            placement = data.oMi[k + 1]
            turns[i, k], places[i, k] = placement.rotation, placement.translation
            twists[i, k, 6] = data.v[k + 1].vector
    back = turns.swapaxes(-1, -2)
    twists[:, :, :3, :3] = turns
    twists[:, :, :3, 3:] = 0.0
    twists[:, :, 3:6, 3:] = turns
    # A rotation w of the base moves the body's origin p at w x p: one row per unit rotation.
    twists[:, :, 3:6, :3] = np.einsum("tbij,tbjk->tbki", back, -skew(places))
    of_bodies = _regressors(twists)
    linear = np.einsum("tbij,tbkjn->tbkin", turns, of_bodies[..., :3, :])
    angular = np.einsum("tbij,tbkjn->tbkin", turns, of_bodies[..., 3:, :])
    angular += np.einsum("tbij,tbkjn->tbkin", skew(places), linear)
    whole = np.concatenate([linear, angular], axis=-2)
    return whole.transpose(0, 2, 3, 1, 4).reshape(times, 7, 6, PARAMETERS * bodies)


def _regressors(twists: Array) -> Array:
    """Return the matrices from a body's parameters to its momentum in its frame. (..., 6, 10)."""
    linear, angular = twists[..., :3], twists[..., 3:]
    x, y, z = np.moveaxis(angular, -1, 0)
    found = np.zeros((*twists.shape[:-1], 6, PARAMETERS))
    found[..., :3, 0] = linear
    found[..., :3, 1:4] = skew(angular)
    found[..., 3:, 1:4] = -skew(linear)
    for row, columns in enumerate(((4, 5, 7), (5, 6, 8), (7, 8, 9))):
        for column, rate in zip(columns, (x, y, z), strict=True):
            found[..., 3 + row, column] = rate
    return found
