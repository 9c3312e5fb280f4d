"""The motion of the joints between the points of a trajectory, as a controller interpolates it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from math import comb

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import ROWS, a_vector
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.configuration import without_turns

# Accuracy of extremes [rad, rad/s, rad/s2]: far below that of any limit.
_EXACT = 1e-9
# Rounding error of the halving of pieces, relative to a polynomial's largest coefficient.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joints on the quintics through positions, velocities and accelerations at the points.

    ROS's `joint_trajectory_controller` interpolates a trajectory that has all three in this way.
    """

    time: Array = declare(  # shape (points,)
        a_vector(None),
        "from the state, strictly increasing, two or more",
        unit="s",
    )
    # All three have the shape (points, joints)
    positions: Array = declare(ROWS, "a row per time", unit="rad, m")
    velocities: Array = declare(ROWS, "a row per time", unit="rad/s, m/s")
    accelerations: Array = declare(ROWS, "a row per time", unit="rad/s2, m/s2")

    __repr__ = in_a_line

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations, each of shape (times, joints).

        Before the first and after the last point the first and last quintics are extrapolated.
        """
        last = len(self.time) - 2
        piece = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, last)
        step = np.diff(self.time)[piece, None]
        part = (time - self.time[piece])[:, None] / step
        # De Casteljau's: of six coefficients five, four, three and so on.
        left = self._coefficients[0][:, piece]
        while len(left) > 3:
            left = left[:-1] + part * (left[1:] - left[:-1])
        of_rates = left[1:] - left[:-1]
        accelerations = (of_rates[1] - of_rates[0]) * (20 / step**2)
        rates = (of_rates[0] + part * (of_rates[1] - of_rates[0])) * (5 / step)
        left = left[:-1] + part * of_rates
        return left[0] + part * (left[1] - left[0]), rates, accelerations

    def between(self, begin: float, end: float) -> JointMotion:
        """Return the motion with the points alone on which its values between two times depend.

        Args:
            begin: The first time [s].
            end: The last time [s].
        """
        first = int(np.searchsorted(self.time, begin, side="right")) - 1
        first = min(max(first, 0), len(self.time) - 2)
        # At a point `at` takes the quintic behind it.
        last = max(int(np.searchsorted(self.time, end, side="right")), first + 1)
        kept = slice(first, last + 1)
        return JointMotion(*(getattr(self, item.name)[kept] for item in fields(self)))

    def extremes(self, order: int = 0) -> tuple[Array, Array]:
        """Return the lowest and highest value of each joint between first and last point, and when.

        Args:
            order: 0 for positions, 1 for rates, 2 for accelerations.

        Returns:
            Values, exact to `_EXACT` or to rounding, and their times: each of shape (2, joints).
        """
        pieces = self._coefficients[order]
        both = np.concatenate([-pieces, pieces], axis=2)
        values, times = _highest(both, self.time)
        signs = np.array([[-1.0], [1.0]])
        return signs * values.reshape(2, -1), times.reshape(2, -1)

    def least_distance(
        self, lower: Array, upper: Array, order: int = 0, weights: Array | float = 1.0
    ) -> float:
        """Return the least distance of any joint to its limits, each times its joint's weight.

        Args:
            lower: Of positions, rates or accelerations, as `order` is 0, 1 or 2. Shape (joints,).
            upper: As lower.
        """
        pieces = self._coefficients[order]
        beyond = np.concatenate([weights * (lower - pieces), weights * (pieces - upper)], axis=2)
        beyond = beyond[..., np.isfinite(beyond[0, 0])].reshape(len(pieces), -1)
        exact = max(_EXACT, _ROUNDING * float(np.abs(pieces).max()))
        return -_highest_of_all(beyond, exact)

    def bounds(self, order: int = 0) -> Array:
        """Return values that no joint is below or above, in a tenth of the time: (2, joints)."""
        pieces = self._coefficients[order]
        return np.array([pieces.min(axis=(0, 1)), pieces.max(axis=(0, 1))])

    def largest(self, orders: int) -> Array:
        """Return the largest modulus of positions, rates and so on between any two points.

        Shape (orders, pieces, joints).
        """
        pieces, step = list(self._coefficients), np.diff(self.time)[:, None]
        for degree in range(3, 5 - orders, -1):
            pieces.append(np.diff(pieces[-1], axis=0) * (degree / step))
        return np.array([np.abs(one).max(axis=0) for one in pieces[:orders]])

    @cached_property
    def _coefficients(self) -> tuple[Array, Array, Array]:
        """Positions, rates, accelerations in Bernstein's form: (degree + 1, pieces, joints)."""
        step = np.diff(self.time)[:, None]
        p, v, a = self.positions, step * self.velocities[:-1], step**2 * self.accelerations[:-1]
        v_end, a_end = step * self.velocities[1:], step**2 * self.accelerations[1:]
        first = [p[:-1], p[:-1] + v / 5, p[:-1] + 2 * v / 5 + a / 20]
        last = [p[1:] - 2 * v_end / 5 + a_end / 20, p[1:] - v_end / 5, p[1:]]
        positions = np.array([*first, *last])
        rates = np.diff(positions, axis=0) * (5 / step)
        return positions, rates, np.diff(rates, axis=0) * (4 / step)


def in_turns_of(
    positions: Array, motion: JointMotion, continuous: Sequence[bool] | bool
) -> JointMotion:
    """Return a motion whose continuous joints are in the turns that they have counted.

    Args:
        positions: At time zero, or where the joints are before the motion begins. Shape (joints,).
        continuous: Which joints are.
    """
    (planned,), _, _ = motion.at(np.maximum(motion.time[:1], 0.0))
    off = positions - planned
    turns = off - without_turns(off, continuous)
    return replace(motion, positions=motion.positions + turns) if turns.any() else motion


def joint_motion(trajectory: Trajectory, start: float = 0.0) -> JointMotion:
    """Return a controller's interpolation of a trajectory; it begins at `start` [s]."""
    return JointMotion(
        start + trajectory.time,
        trajectory.joint_positions,
        trajectory.joint_velocities,
        trajectory.joint_accelerations,
    )


def steady_motion(begin: float, end: float, positions: Array, rates: Array) -> JointMotion:
    """Return a motion at constant rates [rad/s, m/s] from positions [rad, m].

    It lasts from `begin` to `end` [s], but at least one second.
    """
    # A quintic is inaccurate far beyond its points, and between two that are nearly simultaneous.
    span, none = max(end - begin, 1.0), np.zeros((2, len(rates)))
    return JointMotion(
        np.array([begin, begin + span]),
        np.array([positions, positions + span * rates]),
        none + rates,
        none,
    )


def _highest(coefficients: Array, time: Array) -> tuple[Array, Array]:
    """Return the highest value of each of several piecewise polynomials, and its time.

    No value of a polynomial exceeds its highest coefficient in Bernstein's form. Pieces whose bound
    exceeds the highest value found are halved, which reduces the gap of the bound to a quarter.

    Args:
        coefficients: In Bernstein's form. Shape (degree + 1, pieces, polynomials).
        time: At which the pieces begin and end. Shape (pieces + 1,).
    """
    size, count, polynomials = coefficients.shape
    parts = [_half(size), _half(size)[::-1, ::-1]]
    which = np.tile(np.arange(polynomials), count)
    begin, width = (np.repeat(at, polynomials) for at in (time[:-1], np.diff(time)))
    pieces = coefficients.reshape(size, -1)
    highest, when = np.full(polynomials, -np.inf), np.zeros(polynomials)
    # Of values without measure rounding leaves no absolute digits.
    exact = np.maximum(_EXACT, _ROUNDING * np.abs(coefficients).max(axis=(0, 1)))
    while pieces.size:
        for at_end, times in ((pieces[0], begin), (pieces[-1], begin + width)):
            order = np.argsort(at_end, kind="stable")  # of equal indices numpy keeps the last
            found, found_when = highest.copy(), when.copy()
            found[which[order]], found_when[which[order]] = at_end[order], times[order]
            better = found > highest
            highest, when = np.where(better, found, highest), np.where(better, found_when, when)
        open_ = pieces.max(axis=0) > (highest + exact)[which]
        pieces = np.concatenate([part @ pieces[:, open_] for part in parts], axis=1)
        which, half, first = which[open_], width[open_] / 2, begin[open_]
        which, width = np.concatenate([which, which]), np.concatenate([half, half])
        begin = np.concatenate([first, first + half])
    return highest, when


def _highest_of_all(pieces: Array, exact: float) -> float:
    """Return the highest value of several polynomials together, as `_highest` finds that of one.

    Args:
        pieces: In Bernstein's form. Shape (degree + 1, pieces).
        exact: The value may be too low by as much.
    """
    highest = float(pieces[[0, -1]].max(initial=-np.inf))
    while True:
        pieces = pieces[:, pieces.max(axis=0) > highest + exact]
        if not pieces.size:
            return highest
        pieces = np.concatenate(_eighths(len(pieces)) @ pieces, axis=1)
        highest = max(highest, float(pieces[[0, -1]].max()))


@cache
def _half(size: int) -> Array:
    """Return the matrix from the coefficients of a piece to those of its first half."""
    return np.array([[comb(i, j) / 2**i for j in range(size)] for i in range(size)])


@cache
def _eighths(size: int) -> Array:
    """Return the matrices from the coefficients of a piece to those of its eight parts."""
    parts = halves = np.array([_half(size), _half(size)[::-1, ::-1]])
    for _ in range(2):
        parts = (halves[:, None] @ parts).reshape(-1, size, size)
    return parts
