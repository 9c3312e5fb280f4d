"""The impact of a grasp on chaser, arm and a body whose twist differs from the end effector's.

Before contact, with mass matrix M, the system moves at v- and the body has momentum h. After it
both move as one, and the joints transmit no impulsive torque. The impulses between tool and body do
no work in any common motion, so with J the end effector's Jacobian and I the body's inertia there,

    (M + J^T I J) v+ = M v- + J^T h,    impulse on the body: I J v+ - h.

On a table, or if wheels hold the chaser, the rows that are held are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import mass_matrix
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import momenta_of

# Directions that the search for the largest impulse starts from: axes, diagonals of faces and of
# the cube. The largest is that of a smooth function on a sphere with few maxima.
_DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
)
# Steps to that maximum: each at least as good as the one before.
_STEPS = 100


@dataclass(frozen=True, eq=False)
class Impact:
    """State and impulse after the end effector has grasped a body."""

    after: SystemState  # of chaser and arm
    twist_body_in_ee: Array  # after contact, at the end effector's origin, in its axes; shape (6,)
    impulse_in_ee: Array  # on the body there: linear [N s], then angular [N m s]; shape (6,)


def impact(robot: Robot, inertia: pin.Inertia, before: SystemState, twist_body: Array) -> Impact:
    """Return state and impulse after a rigid grasp; with wheels, they take up the lost momentum.

    Args:
        inertia: Inertia of the body, in the end effector's frame.
        before: State of chaser and arm before contact.
        twist_body: Twist of the body before contact, at the end effector's origin, in inertial
            axes, linear first. Shape (6,) [m/s, rad/s].
    """
    contact = _Contact(robot, inertia, before)
    momentum = contact.inertia @ contact.in_ee(twist_body)
    v, free = contact.v, contact.free
    known = contact.mass @ v + contact.jacobian.T @ momentum
    held = np.setdiff1d(range(len(v)), free)
    both, after = contact.mass_of_both, v.copy()
    rest = known[free] - both[np.ix_(free, held)] @ v[held]
    after[free] = np.linalg.solve(both[np.ix_(free, free)], rest)
    state = replace(
        system_state(robot, contact.q, after), joint_accelerations=before.joint_accelerations
    )
    if robot.wheels is not None:
        # The wheels take the angular momentum that the bodies lose about axes that are held.
        lost = (known - both @ after)[3:6] @ robot.rotation_chaser_to_base
        stored = momenta_of(robot.wheels, before) + robot.wheels.shares @ lost
        state = replace(state, wheel_momenta=stored)
    twist = contact.jacobian @ after
    return Impact(state, twist, contact.inertia @ twist - momentum)


def largest_impulses(
    robot: Robot, inertia: pin.Inertia, before: SystemState, errors: tuple[float, float]
) -> tuple[float, float]:
    """Return the largest impulses by errors of the body's twist: linear [N s], angular [N m s].

    Args:
        inertia: Inertia of the body, in the end effector's frame.
        before: State of chaser and arm; without errors the body moves as the end effector does.
        errors: Largest errors of the body's velocity there [m/s] and angular velocity [rad/s], in
            any direction in which the end effector can move (`tip_rows`).
    """
    contact = _Contact(robot, inertia, before)
    free = contact.free
    moving, both = contact.jacobian[:, free], contact.mass_of_both[np.ix_(free, free)]
    response = moving @ np.linalg.solve(both, moving.T)
    by_twist = contact.inertia @ response @ contact.inertia - contact.inertia
    axes, rows = contact.rotation.T, robot.base.tip_rows
    by_velocity = errors[0] * by_twist[:, :3] @ axes[:, [row for row in rows if row < 3]]
    by_rate = errors[1] * by_twist[:, 3:] @ axes[:, [row - 3 for row in rows if row >= 3]]
    return _largest(by_velocity[:3], by_rate[:3]), _largest(by_velocity[3:], by_rate[3:])


def _largest(first: Array, second: Array) -> float:
    """Return max |A x + B y| over |x| and |y| of at most one; A, B of shape (3, any).

    It is the maximum of |A^T u| + |B^T u| over unit vectors u, which is convex in u: the direction
    of its gradient is never worse.
    """
    # The start directions include the best ones of A and B alone.
    u = np.vstack([_DIRECTIONS, np.linalg.svd(first)[0].T, np.linalg.svd(second)[0].T])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    tiny = np.finfo(float).tiny
    for _ in range(_STEPS):
        a, b = u @ first, u @ second
        a /= np.linalg.norm(a, axis=1, keepdims=True) + tiny
        b /= np.linalg.norm(b, axis=1, keepdims=True) + tiny
        gradient = a @ first.T + b @ second.T
        size = np.linalg.norm(gradient, axis=1, keepdims=True)
        u = np.where(size > 0.0, gradient / (size + tiny), u)
    worth = np.linalg.norm(u @ first, axis=1) + np.linalg.norm(u @ second, axis=1)
    return float(worth.max())


class _Contact:
    """Inertias at the moment of a contact."""

    def __init__(self, robot: Robot, inertia: pin.Inertia, before: SystemState) -> None:
        self.q, self.v = configuration(robot, before)
        model, data, tip = robot.model, robot.model.createData(), robot.tip_frame_id
        pin.computeJointJacobians(model, data, self.q)
        self.jacobian = np.array(pin.getFrameJacobian(model, data, tip, pin.LOCAL))
        self.rotation = pin.updateFramePlacement(model, data, tip).rotation.copy()
        upper = np.triu(mass_matrix(robot, data, self.q))
        self.mass = upper + np.triu(upper, 1).T
        self.inertia = np.array(inertia.matrix())
        self.mass_of_both = self.mass + self.jacobian.T @ self.inertia @ self.jacobian
        self.free = np.array([*robot.base.rows, *range(6, model.nv)])

    def in_ee(self, twist: Array) -> Array:
        """Return a twist in inertial axes in the axes of the end effector."""
        return np.concatenate([twist[:3] @ self.rotation, twist[3:] @ self.rotation])
