"""Joint splines by numpy and Pinocchio: what the compiled core is compared with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from reference_base_turn import (
    BaseTurn,
    TurnDerivatives,
    base_turn,
    momentum_maps,
    turn_derivatives,
)
from reference_end_conditions import EndPoint, end_conditions
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.joint_spline import JointSplines, _hulls
from ff_planner_ros.planning.paths.path_family import Sensitivity
from ff_planner_ros.planning.paths.spline_basis import FIXED
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import base_acceleration
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.rotation import skew


class ReferenceMotion(NamedTuple):
    """A motion with what its derivatives need."""

    q: Array
    v: Array
    q_half_way: Array
    goal_error: Array
    joints: tuple[Array, Array, Array]  # angles, rates, accelerations; shape (half steps, joints)
    turn: BaseTurn


def reference_motion(family: JointSplines, x: Array, points: int) -> ReferenceMotion:
    """Return what `JointSplines.motion` does."""
    robot, duration, controls = family.robot, family.basis.duration, family.control_points(x)
    angles, rates, accelerated = (rows @ controls for rows in _rows(family, points))
    center, momentum = _conserved(family)
    q_start, _ = configuration(robot, family.problem.start)
    rotation = pin.Quaternion(q_start[3:7]).toRotationMatrix()
    maps = momentum_maps(robot, angles)
    turn = base_turn(maps, rates, rotation, momentum[3:], duration / (points - 1))
    drift = momentum[:3] / pin.computeTotalMass(robot.model)
    centers = center + np.linspace(0.0, duration, len(angles))[:, None] * drift
    q, q_half_way = (
        np.hstack(
            [
                centers[at] - np.einsum("pij,pj->pi", rotations, maps.center[at]),
                Rotation.from_matrix(rotations).as_quat(),
                angles[at],
            ]
        )
        for rotations, at in ((turn.rotations, np.s_[::2]), (turn.half_way, np.s_[1::2]))
    )
    base_rates = turn.rates[::4]
    linear = drift @ turn.rotations - np.cross(base_rates, maps.center[::2])
    linear -= np.einsum("pij,pj->pi", maps.of_center[::2], rates[::2])
    v = np.hstack([linear, base_rates, rates[::2]])
    if robot.base is Base.PLANAR:  # the table takes up what an axis is off its normal
        q[:, 2] = q_half_way[:, 2] = q_start[2]
        v[:, 2] = 0.0
    of_base = base_acceleration(robot, robot.model.createData(), q[-1], v[-1], accelerated[-1])
    none = np.empty((robot.model.nv, 0))
    end = EndPoint(q[-1], v[-1], np.append(of_base, accelerated[-1]), none, none, none[6:])
    goal_error, _ = end_conditions(robot, family.problem.target, end, duration)
    return ReferenceMotion(q, v, q_half_way, goal_error, (angles, rates, accelerated), turn)


def reference_sensitivity(family: JointSplines, motion: ReferenceMotion) -> Sensitivity:
    """Return the derivatives of a motion."""
    robot, duration, points = family.robot, family.basis.duration, len(motion.q)
    of_angles, of_rates, of_accelerations = (
        _of_joints(rows, robot.joints) for rows in _rows(family, points)
    )
    step, maps = duration / (points - 1), motion.turn.maps
    of_turn = turn_derivatives(robot, motion.turn, motion.joints[:2], (of_angles, of_rates), step)
    q, q_half_way = (
        np.concatenate(
            [skew(maps.center[at]) @ turns - maps.of_center[at] @ by_x, turns, by_x], axis=1
        )
        for turns, at, by_x in (
            (of_turn.turns, np.s_[::2], of_angles[::2]),
            (of_turn.half_way, np.s_[1::2], of_angles[1::2]),
        )
    )
    mass = pin.computeTotalMass(robot.model)
    drift = _conserved(family)[1][:3] / mass @ motion.turn.rotations
    linear = skew(drift) @ of_turn.turns + skew(maps.center[::2]) @ of_turn.rates
    linear -= of_turn.of_linear / mass @ of_angles[::2]
    linear -= maps.of_center[::2] @ of_rates[::2]
    v = np.concatenate([linear, of_turn.rates, of_rates[::2]], axis=1)
    if robot.base is Base.PLANAR:
        q[:, 2] = q_half_way[:, 2] = v[:, 2] = 0.0
    acceleration = _acceleration(family, motion, of_turn)
    end = EndPoint(motion.q[-1], motion.v[-1], acceleration[-1], q[-1], v[-1], of_accelerations[-1])
    _, goal_error = end_conditions(robot, family.problem.target, end, duration)
    return Sensitivity(
        q=q, v=v, q_half_way=q_half_way, goal_error=goal_error, acceleration=acceleration
    )


def hulls(family: JointSplines, x: Array) -> list[tuple[Array, Array]]:
    """Return points whose range bounds each joint, then its rate, each with derivatives by x.

    Shapes (points, joints) and (points, joints, variables).
    """
    found, joints = [], np.eye(family.robot.joints)
    for order, rows in enumerate(_hulls(family.basis)):
        points = rows @ family.control_points(x)
        by_x = np.einsum("pv,jk->pjkv", family.free(rows), joints).reshape(*points.shape, -1)
        if family.goal_motion is not None:
            by_duration = family.moved(rows) - order / family.basis.duration * points
            by_x = np.dstack([by_x, by_duration])
        found.append((points, by_x))
    return found


def _acceleration(family: JointSplines, motion: ReferenceMotion, of_turn: TurnDerivatives) -> Array:
    """Return dv/dt at the points, from the momenta's derivative in time. (points, 6 + joints).

    In base axes:  d/dt (I omega + A theta') = -omega x R^T L, and likewise for P.
    """
    maps, base_rates = motion.turn.maps, motion.turn.rates[::4]
    _, rates, accelerated = (of_time[::2, :, None] for of_time in motion.joints)
    mass = pin.computeTotalMass(family.robot.model)
    drift = _conserved(family)[1][:3] / mass @ motion.turn.rotations
    angular = -np.cross(base_rates, motion.turn.momenta[::4])
    angular -= (of_turn.of_angular @ rates + maps.coupling[::2] @ accelerated)[:, :, 0]
    angular = np.einsum("pij,pj->pi", maps.to_rate[::2], angular)
    linear = -np.cross(base_rates, drift) - np.cross(angular, maps.center[::2])
    linear -= (of_turn.of_linear / mass @ rates + maps.of_center[::2] @ accelerated)[:, :, 0]
    if family.robot.base is Base.PLANAR:
        linear[:, 2] = 0.0
    return np.hstack([linear, angular, accelerated[:, :, 0]])


def _rows(family: JointSplines, points: int) -> tuple[Array, Array, Array]:
    """Return what control points contribute to angles, rates and accelerations at half steps."""
    s = np.linspace(0.0, 1.0, 2 * points - 1)
    return family.basis.rows(s), family.basis.rows(s, 1), family.basis.rows(s, 2)


def _of_joints(rows: Array, joints: int) -> Array:
    """Return rows for the free control points of one joint as those for all. (rows, joints, x)."""
    return np.array([np.kron(np.eye(joints), row) for row in rows[:, FIXED:]])


def _conserved(family: JointSplines) -> tuple[Array, Array]:
    """Return the centre of mass at the start, total P, and L about that centre."""
    robot, data = family.robot, family.robot.model.createData()
    q, v = configuration(robot, family.problem.start)
    momentum, center = total_momentum(robot, data, q, v), pin.centerOfMass(robot.model, data, q)
    momentum[3:] -= np.cross(center, momentum[:3])
    return center.copy(), momentum
