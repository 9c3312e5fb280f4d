"""Initial guesses of joint splines that turn the chaser: loops of the joints on top of a path.

Without momentum the base's angular velocity is w = sum A_j(q) dq_j/dt, in its own axes. A loop
d(t) of the joints that comes back to where it began turns the base, to second order in its size, by

    sum over i < j of F_ij a_ij,   F_ij = dA_j/dq_i - dA_i/dq_j + A_i x A_j,
    a_ij = 1/2 closed integral of (d_i dd_j - d_j dd_i),

with F the curvature of the connection A. A loop d = u f(t) + v g(t) in the plane of two joint
directions u, v has a = area (u v^T - v u^T). For any u, the turns by all v are linear in v: the
shortest v for a wanted turn follows. Of many u the smallest loops are tried first.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.even_normals import even_normals
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import base_twist
from ff_planner_ros.robot.quaternion import (
    quaternion_inverse,
    quaternion_product,
    rotation_vector_from_quaternion,
)

if TYPE_CHECKING:
    from ff_planner_ros.planning.paths.joint_spline import JointSplines

# Steps of the differences that the curvature is taken from [rad, m].
_STEP = 1e-4
# Directions of which the best are tried, and how many loops come before the first guess.
_DIRECTIONS, _LOOPS = 128, 12
# Rounds in which a loop's size is corrected by the turn that it makes, and its factor in each.
_ROUNDS, _MOST = 4, 2.0
# Few points are accurate enough for a guess.
_POINTS = 25
# A joint that is nearer to its limits [rad, m] moves less in a loop.
_ROOM = 1.0


def with_loops(family: JointSplines, guesses: Iterator[Array]) -> Iterator[Array]:
    """Yield guesses, before each the smallest loop on top of it that leads the chaser to its goal.

    Before the first guess come several.
    """
    for number, guess in enumerate(guesses):
        for loop in islice(_loops(family, guess, number), _LOOPS if number == 0 else 1):
            yield guess + loop
        yield guess


def _loops(family: JointSplines, guess: Array, number: int) -> Iterator[Array]:
    """Yield loops on top of a guess by size, as changes of its variables."""
    wanted = _missing(family, guess)
    if float(np.linalg.norm(wanted)) <= family.problem.chaser_goal.most:
        return
    motion = family.motion(guess, _POINTS)
    middle = motion.q[_POINTS // 2, 7:]
    robot = family.robot
    room = np.minimum(middle - robot.lower_position_limits, robot.upper_position_limits - middle)
    scale = np.clip(room, 0.05, _ROOM) / robot.joint_weights
    curved = np.einsum("ijk,i,j->ijk", curvature(robot, middle), scale, scale)
    first, second, area = _shapes(family)
    found = list[tuple[float, Array, Array]]()
    begin = _DIRECTIONS * number
    for direction in islice(even_normals(robot.joints), begin, begin + _DIRECTIONS):
        u = direction / np.linalg.norm(direction)
        v, *_ = np.linalg.lstsq(area * np.einsum("ijk,i->kj", curved, u), wanted, rcond=1e-6)
        size = float(np.linalg.norm(v))
        found.append((size, u, v))
    for size, u, v in sorted(found, key=lambda one: one[0]):
        of_both = np.sqrt(max(size, 1e-12))
        along, across = of_both * scale * u, scale * v / of_both
        loop = (np.outer(along, first) + np.outer(across, second)).ravel()
        yield _sized(family, guess, loop, wanted)
        yield _sized(family, guess, -loop, wanted)


def _sized(family: JointSplines, guess: Array, loop: Array, wanted: Array) -> Array:
    """Return a loop with a size at which it turns the chaser by about as much as is wanted."""
    size = 1.0
    for _ in range(_ROUNDS):
        made = wanted - _missing(family, guess + size * loop)
        along = float(made @ wanted) / float(wanted @ wanted)
        size *= float(np.clip(np.sqrt(1.0 / max(along, 1e-3)), 1.0 / _MOST, _MOST))
    return size * loop


def _missing(family: JointSplines, x: Array) -> Array:
    """Return the turn that a path's end lacks to the chaser's goal, in base axes. Shape (3,)."""
    problem, q = family.problem, family.motion(x, _POINTS).q
    to_base = eigen_quaternion(problem.robot.rotation_chaser_to_base)
    first, last = quaternion_product(q[[0, -1], 3:7], to_base)
    turn = quaternion_product(quaternion_inverse(last), problem.chaser_goal.wanted(first))
    return problem.robot.rotation_chaser_to_base @ rotation_vector_from_quaternion(turn)


def _shapes(family: JointSplines) -> tuple[Array, Array, float]:
    """Return the free control points of both shapes of a loop, and the area between them."""
    s = np.linspace(0.0, 1.0, 8 * family.basis.spans + 1)
    bump = 64.0 * s**3 * (1.0 - s) ** 3
    rows = family.basis.on_grid(len(s))
    free = family.free(rows)
    shapes = np.array([bump, 2.5 * bump * (1.0 - 2.0 * s)]).T
    points, *_ = np.linalg.lstsq(free, shapes)
    made = free @ points
    area = float(np.sum(made[:-1, 0] * made[1:, 1] - made[1:, 0] * made[:-1, 1])) / 2.0
    return points[:, 0], points[:, 1], area


def curvature(robot: Robot, joints: Array) -> Array:
    """Return F_ij at joint positions, by differences. Shape (joints, joints, 3)."""
    steps = _STEP * np.eye(robot.joints)
    by = np.array([_turning(robot, joints + s) - _turning(robot, joints - s) for s in steps])
    by /= 2.0 * _STEP
    here = _turning(robot, joints)
    found: Array = by - by.swapaxes(0, 1) + np.cross(here[:, None], here[None])
    return found


def _turning(robot: Robot, joints: Array) -> Array:
    """Return A_j: the base's angular velocity by each joint's rate, without momentum.

    In base axes. Shape (joints, 3).
    """
    q = np.concatenate([np.zeros(6), [1.0], joints])
    data, nothing = robot.model.createData(), np.zeros(6)
    rates = np.eye(robot.joints)
    return np.array([base_twist(robot, data, q, nothing, rate)[3:] for rate in rates])
