"""Momentum of a free-floating system, Eqs. (24)-(26), and its generalised Jacobian, Eq. (32).

Throughout, `data` is scratch space of the robot's model, q a configuration, shape (7 + joints,),
and v a tangent velocity, shape (6 + joints,). A momentum is P [kg m/s] and L about the inertial
origin [kg m2/s], in inertial axes, shape (6,). On a planar base only P_x, P_y and L_z are constant:
the table takes up the other components, and no function here reads them.

Momentum is linear in the inertial parameters. Those of a body are Pinocchio's ten: mass, mass
times centre of mass, and the inertia about the origin of the body's frame (xx, xy, yy, xz, yz, zz).
Bodies are the chaser and what each joint moves, links that are fixed to each other being one body.
"""

from __future__ import annotations

from dataclasses import replace
from math import factorial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import cross, skew
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import momenta_of

PARAMETERS = 10  # of a body


def total_momentum(robot: Robot, data: pin.Data, q: Array, v: Array) -> Array:
    """Return linear and angular momentum of the whole system, Eq. (24)."""
    total = np.array(pin.computeCentroidalMomentum(robot.model, data, q, v).vector)
    total[3:] += cross(data.com[0], total[:3])
    return total


def total_momenta(robot: Robot, q: Array, v: Array, maps: Array | None = None) -> Array:
    """Return `total_momentum` at each row of q and v. Shape (points, 6).

    Args:
        maps: The result of `momentum_maps`. None: they are computed.
    """
    if maps is None:
        maps = momentum_maps(robot, robot.model.createData(), q)
    return momenta_about_origin(q, (maps @ v[:, :, None])[:, :, 0])


def momenta_about_origin(q: Array, in_base: Array) -> Array:
    """Return momenta that are given about the base's origin, in its axes. Shape (points, 6)."""
    total = (in_base.reshape(-1, 2, 3) @ rotation_base_to_inertial(q).swapaxes(1, 2)).reshape(-1, 6)
    total[:, 3:] += cross(q[:, :3], total[:, :3])
    return total


def angular_momenta(
    robot: Robot, q: Array, v: Array, joint_accelerations: Array
) -> tuple[Array, Array]:
    """Return the system's angular momentum about its centre of mass, for a chaser at held attitude.

    Args:
        joint_accelerations: Shape (times, joints) [rad/s2, m/s2].

    Returns:
        The momentum and its rate, in axes of the base link, each of shape (times, 3) [N m s, N m].
    """
    model, data = robot.model, robot.model.createData()
    momenta, rates, dv = np.empty((len(q), 3)), np.empty((len(q), 3)), np.zeros((len(q), model.nv))
    dv[:, 6:] = joint_accelerations  # a translation of the whole has no angular momentum
    for k, at in enumerate(zip(q, v, dv, strict=True)):
        pin.computeCentroidalMomentumTimeVariation(model, data, *at)
        momenta[k], rates[k] = data.hg.angular, data.dhg.angular
    axes = rotation_base_to_inertial(q) @ robot.rotation_chaser_to_base
    return np.einsum("tji,tj->ti", axes, momenta), np.einsum("tji,tj->ti", axes, rates)


def angular_momentum_bounds(robot: Robot, largest: Array) -> Array:
    """Return bounds of the derivatives of `angular_momenta`.

    All vectors are sums of vectors that are fixed in a body. The n-th derivative of one of these
    is, by Leibniz' rule,

        r^(n) = sum over k < n of (n - 1 over k) omega^(k) x r^(n - 1 - k),

    and norms of sums and products are at most the sums and products of norms. So the joints bound
    the derivatives of angular velocities and places, link by link, and these the momentum's. Norms
    are kept divided by n!, as in Taylor's series: those of a product are then their convolution.

    Args:
        largest: Moduli of the joints' positions, velocities, and so on, in several spans of time.
            Shape (orders, spans, joints).

    Returns:
        Of order 0 to orders - 2, in [N m s, N m, N m/s, ...]. Shape (orders - 1, spans).
    """
    factorials = np.array([[float(factorial(n))] for n in range(len(largest))])
    largest, sizes = largest / factorials[:, None], _sizes(robot)
    tree = robot.tree
    still = np.zeros(largest.shape[:2])
    rates, places = {1: still[1:]}, {1: still}  # the base is joint 1
    turns = {1: _of_fixed(still[1:])}
    mass, center, momentum = 0.0, still.copy(), still[1:].copy()
    for joint in range(1, len(sizes)):
        body = sizes[joint]
        if joint > 1:
            before, number = robot.model.parents[joint], joint - 2
            of_joint = np.abs(tree.multipliers[number]) * largest[:, :, tree.planned[number]]
            of_joint[0] += np.abs(tree.offsets[number])
            axis = turns[before]
            places[joint], rates[joint] = places[before] + body.offset * axis, rates[before]
            if tree.slides[number].any():
                places[joint] = places[joint] + _product(of_joint, axis)
            else:
                rates[joint] = rates[joint] + _product(_rate(of_joint), axis[:-1])
            turns[joint] = _of_fixed(rates[joint])
        turn = turns[joint]
        at = places[joint] + body.lever * turn
        spin = _product(rates[joint], _product(turn[:-1], turn[:-1]))  # of R I R^T omega
        momentum += body.mass * _product(at[:-1], _rate(at)) + body.inertia * spin
        mass, center = mass + body.mass, center + body.mass * at
    momentum += _product(center[:-1], _rate(center)) / mass
    bounds: Array = momentum * factorials[:-1]
    return bounds


def _product(one: Array, other: Array) -> Array:
    """Return the norms of a product."""
    product: Array = one[0] * other
    for k in range(1, len(one)):
        product[k:] += one[k] * other[:-k]
    return product


def _rate(norms: Array) -> Array:
    """Return the norms of a time derivative, one less."""
    return norms[1:] * np.arange(1.0, len(norms))[:, None]


def _of_fixed(rates: Array) -> Array:
    """Return the norms of a unit vector that is fixed in a body, one more than of its rates."""
    norms = np.ones((len(rates) + 1, rates.shape[1]))
    for n in range(1, len(norms)):
        norms[n] = (rates[:n] * norms[n - 1 :: -1]).sum(axis=0) / n
    return norms


class _Size(NamedTuple):
    """Lengths and masses of a joint and the body that it moves."""

    offset: float  # from the joint before to this one [m]
    lever: float  # from the joint to the body's centre of mass [m]
    mass: float  # [kg]
    inertia: float  # largest about the centre of mass [kg m2]


def _sizes(robot: Robot) -> list[_Size]:
    """Return the sizes of all bodies, by joint."""
    bodies = list(robot.model.inertias)
    offsets = np.array([place.translation for place in robot.model.jointPlacements])
    levers, inertias = (
        np.array(each) for each in zip(*((b.lever, b.inertia) for b in bodies), strict=True)
    )
    columns = (
        np.linalg.norm(offsets, axis=1),
        np.linalg.norm(levers, axis=1),
        np.array([body.mass for body in bodies]),
        np.linalg.eigvalsh(inertias)[:, -1],
    )
    return [_Size(*row) for row in np.array(columns).T.tolist()]


def with_wheel_momenta(robot: Robot, before: SystemState, after: SystemState) -> SystemState:
    """Return a later state with its wheel momenta, from those before; unchanged without wheels."""
    wheels = robot.wheels
    if wheels is None:
        return after
    states = [configuration(robot, state) for state in (before, after)]
    q, v = (np.array(rows) for rows in zip(*states, strict=True))
    (first, last), _ = angular_momenta(robot, q, v, np.zeros((2, robot.joints)))
    momenta = momenta_of(wheels, before) + wheels.shares @ (first - last)
    return replace(after, wheel_momenta=momenta)


def mass_matrix(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return the mass matrix of Eq. (20), of which Pinocchio fills the upper triangle.

    By tangent velocities. Shape (6 + joints, 6 + joints).
    """
    if robot.tree.joints > robot.joints:
        # Where joints mimic others, Pinocchio 4.1 adds to the matrix of the call before.
        data = robot.model.createData()
    return np.array(pin.crba(robot.model, data, q))


def momentum_maps(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return the matrices from tangent velocity to momentum about the base's origin, in its axes.

    The first six rows of the mass matrix at each row of q, which depend on the joints alone. Shape
    (points, 6, 6 + joints).
    """
    return np.array([mass_matrix(robot, data, row)[:6] for row in q])


def generalised_jacobian(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return J_D of Eq. (32): end-effector twist per joint velocity at zero momentum.

    Inertial axes, linear first, only the base's `tip_rows`. Shape (rows, joints).
    """
    (found,) = _generalised(
        robot, momentum_maps(robot, data, q[None]), _jacobian(robot, data, q)[None]
    )
    return np.asarray(found, np.float64)


def arm_jacobian(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return J_m of Eq. (30): end-effector twist per joint velocity on a base that stands still.

    Axes, rows and shape are those of `generalised_jacobian`.
    """
    return _jacobian(robot, data, q)[robot.base.tip_rows, 6:]


def generalised_jacobians(robot: Robot, q: Array, maps: Array | None = None) -> Array:
    """Return `generalised_jacobian` at each row of q. Shape (points, rows, joints).

    Args:
        maps: The result of `momentum_maps`. None: they are computed.
    """
    data = robot.model.createData()
    if maps is None:
        maps = momentum_maps(robot, data, q)
    return _generalised(robot, maps, np.array([_jacobian(robot, data, row) for row in q]))


def _jacobian(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return the Jacobian of the end effector, inertial axes. Shape (6, 6 + joints)."""
    frame, axes = robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED
    jacobian: Array = pin.computeFrameJacobian(robot.model, data, q, frame, axes)
    return jacobian


def _generalised(robot: Robot, mass: Array, jacobian: Array) -> Array:
    """Return J_D at many points."""
    rows = robot.base.rows
    mass, jacobian = mass[..., rows, :], jacobian[..., robot.base.tip_rows, :]
    base_rate_per_joint_rate = -np.linalg.solve(mass[..., rows], mass[..., 6:])
    generalised: Array = jacobian[..., 6:] + jacobian[..., rows] @ base_rate_per_joint_rate
    return generalised


def base_twist(
    robot: Robot, data: pin.Data, q: Array, momentum: Array, joint_rates: Array
) -> Array:
    """Return the base's twist at given momentum and joint velocities, Eq. (27).

    In the base frame. Shape (6,) [m/s, rad/s].
    """
    rows = robot.base.rows
    momentum_map = mass_matrix(robot, data, q)[rows]
    pin.forwardKinematics(robot.model, data, q)
    in_base = data.oMi[1].actInv(pin.Force(momentum)).vector[rows]
    twist = np.zeros(6)
    twist[rows] = np.linalg.solve(
        momentum_map[:, rows], in_base - momentum_map[:, 6:] @ joint_rates
    )
    return twist


def smallest_singular_values(robot: Robot, q: Array, maps: Array | None = None) -> Array:
    """Return the smallest singular value of J_D W^-1 at each row of q, with W the joint weights.

    Shape (points,). See `generalised_jacobians`.
    """
    jacobians = generalised_jacobians(robot, q, maps) / robot.joint_weights
    # The transpose has the same singular values, and takes LAPACK two thirds of the time.
    columns = jacobians.swapaxes(1, 2)
    return np.asarray(np.linalg.svd(columns, compute_uv=False)[:, -1], np.float64)


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
    times, bodies = len(positions), robot.tree.joints + 1
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
