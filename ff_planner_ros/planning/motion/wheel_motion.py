"""Momenta and torques of the wheels that hold a chaser's attitude along a motion.

See `robot.wheels`. Angular momenta are those of Pinocchio's centroidal algorithms. The search,
which needs derivatives, computes its own by inverse dynamics.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.motion.certified_least import Arcs, Known, Pieces, certified_least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import angular_momenta, angular_momentum_bounds
from ff_planner_ros.robot.wheels import Wheels

# Half of the fraction of its limits by which a plan may exceed them.
_GAP = 5e-5


def certain_peaks(
    robot: Robot, wheels: Wheels, motion: FollowedMotion, loads: Sequence[Array], allowed: Array
) -> Array:
    """Return what no load ever exceeds, as far as it takes to tell whether that is allowed.

    Args:
        loads: Momenta and torques of the wheels at the times of the motion, each of shape (times,
            wheels).
        allowed: Momenta [N m s], then torques [N m], of all wheels. Shape (2 wheels,).

    Returns:
        Less than what is allowed, or at most `_GAP` of it above the highest values found, or more
        where the motion is too fast to tell. Shape (2 wheels,).
    """
    stored, sizes = loads[0][0], np.linalg.norm(wheels.shares, axis=1)
    of_vectors = angular_momentum_bounds(robot, motion.joints.largest(5)).repeat(motion.pieces, 1)
    # From order 1 on, of momenta and of torques, between two times. Shape (2, 2, intervals, 1).
    of_both = np.array([of_vectors[1:3], of_vectors[2:4]])[..., None]
    points, known = np.arange(float(len(motion.time))), np.hstack(loads)

    def loads_at(steps: Array) -> Array:
        at, rows = np.unique(np.interp(steps, points, motion.time), return_inverse=True)
        at = np.append(motion.time[0], at)
        positions, rates, accelerations = motion.joints.at(at)
        q, v = np.tile(motion.q[0], (len(at), 1)), np.zeros((len(at), motion.v.shape[1]))
        q[:, 7:], v[:, 6:] = positions, rates
        inside = np.hstack(wheels_along(robot, wheels, stored, q, v, accelerations))
        return np.asarray(inside[1:][rows])

    def certain(load: int, most: float) -> float:
        way, bend = of_both[load // len(sizes), :, :, 0] * sizes[load % len(sizes)]
        steps = np.diff(motion.time)
        way, bend, signs = way * steps, bend * steps**2, np.array([1.0, -1.0])
        highest = float(np.abs(known[:, load]).max()) + float(bend.max()) / 8
        if highest <= most:  # as of a wheel without a limit
            return highest
        # What is left in either sense.
        ends = [
            Known((most - signs[:, None] * at).ravel())
            for at in (known[:-1, load], known[1:, load])
        ]
        which, begin = np.repeat([0, 1], len(steps)), np.tile(points[:-1], 2)

        def values_at(at: Array, sense: Indices) -> Known:
            return Known(most - signs[sense] * loads_at(at)[:, load])

        def ways(pieces: Pieces) -> Array:
            longest: Array = way[pieces.begin.astype(np.intp)] * (pieces.end - pieces.begin)
            return longest

        def arcs(pieces: Pieces) -> Arcs:
            part = pieces.end - pieces.begin
            bent = bend[pieces.begin.astype(np.intp)] * part**2
            return Arcs(*(one[None] for one in (pieces.at_begin.value, pieces.at_end.value, bent)))

        pieces = Pieces(which, begin, begin + 1.0, *ends)
        gap = _GAP * most
        return (
            most - certified_least(motion.time, pieces, values_at, ways, arcs, gap, 1.0).certified
        )

    return np.array([certain(load, float(most)) for load, most in enumerate(allowed)])


def wheels_along(
    robot: Robot, wheels: Wheels, stored: Array, q: Array, v: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Return momenta [N m s] and torques [N m] of the wheels, each of shape (times, wheels).

    Args:
        stored: Momenta at the first time. Shape (wheels,) [N m s].
        q: Configurations. Shape (times, 7 + joints).
        v: Tangent velocities. Shape (times, 6 + joints).
        accelerations: Of the joints. Shape (times, joints) [rad/s2, m/s2].
    """
    parts, rates = angular_momenta(robot, q, v, accelerations)
    momenta = stored + (parts[0] - parts) @ wheels.shares.T
    return momenta, -rates @ wheels.shares.T
