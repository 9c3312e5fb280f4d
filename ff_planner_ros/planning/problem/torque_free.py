"""Torque-free rotation of a rigid body: Euler's equations, solved by Taylor series.

In axes of the body, with inertia I, angular velocity w and attitude q:

    I w' = (I w) x w,    q' = q (w, 0) / 2.

Both right sides are sums of products, so that each coefficient of the series of w and q follows
from those before it. A series is used as far as its last terms are rounding. It is then exact
between its ends too, and no grid of times is needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen, symmetric_tensor
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.rotation import cross, skew

# Order of a series, and the relative size of its last terms at which it ends. With more terms the
# series reach further, but each costs more.
_ORDER, _ROUNDING = 20, 1e-16
# A series is used for so long at most [s]; if the body rotates so slowly that its last terms
# underflow, until it has rotated so far [rad]; at rest, for longer than any allowed time [s].
_LONG, _LITTLE, _LONGEST = 1e9, 1e-3, 1e101
# Relative to the largest principal moment: a smaller one is that of a line, and the error that
# rounding makes in a plate, whose largest moment is the sum of the others.
_LEAST_MOMENT, _PLATE = 1e-6, 1e-6


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Motion of a frame that is fixed to a body, at some times, in inertial axes."""

    positions: Array  # shape (times, 3) [m]
    rotations: Array  # axes of the frame to inertial axes; shape (times, 3, 3)
    # Linear and angular velocity, and their first and second derivatives; each (times, 6)
    twists: Array  # [m/s, rad/s]
    accelerations: Array  # [m/s2, rad/s2]
    jerks: Array  # [m/s3, rad/s3]


class Turning(NamedTuple):
    """Attitude of a body at some times; angular velocity and its derivatives, in body axes."""

    rotations: Array  # body axes to inertial axes; shape (times, 3, 3)
    rates: Array  # shape (times, 3) [rad/s]
    accelerations: Array  # shape (times, 3) [rad/s2]
    jerks: Array  # shape (times, 3) [rad/s3]


class TorqueFreeMotion:
    """Torque-free rotation of a body from time zero on, solved as far as it is needed.

    Answers do not depend on earlier calls.
    """

    def __init__(self, inertia: Array, quaternion_xyzw: Array, rate: Array) -> None:
        """Begin at time zero.

        Args:
            inertia: About the centre of mass, body axes; only ratios matter. Shape (3, 3).
            quaternion_xyzw: Body axes to inertial axes. Shape (4,).
            rate: Angular velocity, body axes. Shape (3,) [rad/s].
        """
        self._inertia, self._inverse = inertia, np.linalg.inv(inertia)
        # w' = I^-1 sum_bc (I e_b) x e_c  w_b w_c, and q' the same with half the quaternions' units.
        products = cross(inertia.T[:, None], np.eye(3))
        self._of_rates = (products @ self._inverse.T).reshape(9, 3).T.copy()
        self._of_attitude = _QUATERNION_PRODUCTS
        self._begins, self._end = np.empty(0), 0.0
        self._series = np.empty((0, _ORDER + 1, 7))
        self._next = np.concatenate([quaternion_xyzw, rate])

    def at(self, times: Array) -> Turning:
        """Return attitudes and angular velocities.

        Args:
            times: Not negative. Shape (times,) [s].
        """
        self._solve(float(times.max(initial=0.0)))
        number = np.searchsorted(self._begins, times, side="right") - 1
        series, after = self._series[number], (times - self._begins[number])[:, None]
        values = series[:, -1]
        for k in range(_ORDER - 1, -1, -1):
            values = values * after + series[:, k]
        rates = values[:, 4:]
        momenta = rates @ self._inertia.T
        accelerations = cross(momenta, rates) @ self._inverse.T
        jerks = cross(accelerations @ self._inertia.T, rates) + cross(momenta, accelerations)
        return Turning(_rotations(values[:, :4]), rates, accelerations, jerks @ self._inverse.T)

    def attitude_series(self, until: float) -> tuple[Array, Array]:
        """Return the begin of each series and its coefficients of q, as far as a time [s]."""
        self._solve(until)
        count = int(np.searchsorted(self._begins, until, side="right"))
        return self._begins[:count], self._series[:count, :, :4]

    def _solve(self, until: float) -> None:
        """Add series until they reach a time [s]."""
        begins, series = [], []
        while self._end <= until:
            terms = self._terms(self._next)
            length = _radius(terms)
            begins.append(self._end)
            series.append(terms)
            self._end += length
            end = terms[-1]
            for term in terms[-2::-1]:
                end = end * length + term
            end[:4] /= np.linalg.norm(end[:4])
            self._next = end
        if begins:
            self._begins = np.concatenate([self._begins, begins])
            self._series = np.concatenate([self._series, series])

    def _terms(self, begin: Array) -> Array:
        """Return the coefficients of the series of q and w. Shape (order + 1, 7)."""
        terms = np.zeros((_ORDER + 1, 7))
        terms[0] = begin
        for k in range(_ORDER):
            products = terms[: k + 1].T @ terms[k::-1, 4:] / (k + 1)
            terms[k + 1, :4] = self._of_attitude @ products[:4].ravel()
            terms[k + 1, 4:] = self._of_rates @ products[4:].ravel()
        return terms


def _radius(terms: Array) -> float:
    """Return how long a series is used [s]."""
    rate = float(np.abs(terms[0, 4:]).max())
    powers = np.arange(_ORDER - 1, _ORDER + 1)
    sizes = np.stack(
        [
            np.abs(terms[powers, :4]).max(axis=1),
            np.abs(terms[powers, 4:]).max(axis=1) / max(rate, 1e-300),
        ]
    )
    with np.errstate(divide="ignore"):
        lengths = (_ROUNDING / sizes) ** (1.0 / powers)
    slow = _LONGEST if rate < _LITTLE / _LONGEST else _LITTLE / rate
    return float(min(lengths.min(), max(_LONG, slow)))


def _quaternion_products() -> Array:
    """Return the matrix of (q, w) -> q (w, 0) / 2 from the products q_a w_b. Shape (4, 12)."""
    matrix = np.zeros((4, 4, 3))
    for a in range(3):  # the vector part of q:  v x w,  -v . w
        matrix[:3, a] = skew(np.eye(3)[a])
        matrix[3, a, a] = -1.0
    matrix[:3, 3] = np.eye(3)  # its scalar part
    return matrix.reshape(4, 12) / 2.0


_QUATERNION_PRODUCTS = _quaternion_products()


def _rotations(quaternions_xyzw: Array) -> Array:
    """Return rotation matrices of quaternions that are of unit length but for rounding."""
    vector, scalar = quaternions_xyzw[:, :3], quaternions_xyzw[:, 3, None, None]
    cross = skew(vector)
    # Dividing by the square of the length makes it orthogonal to the last digits.
    square = (quaternions_xyzw**2).sum(axis=1)[:, None, None]
    rotations: Array = np.eye(3) + 2.0 * (scalar * cross + cross @ cross) / square
    return rotations


def possible_inertia(field: str, inertia: Array) -> Array:
    """Return an inertia, symmetric to the last bit. Shape (3, 3).

    Raises:
        InvalidInput: It is not symmetric, or no body has its principal moments.
    """
    found = symmetric_tensor(field, inertia)
    found = frozen(found / 2.0 + found.T / 2.0)
    least, middle, largest = np.linalg.eigvalsh(found).tolist()
    told = f"{found.tolist()} with principal moments {least:.6g}, {middle:.6g}, {largest:.6g}"
    if not least > _LEAST_MOMENT * largest:
        allowed = (
            f"each must be positive, and more than {_LEAST_MOMENT:g} of the largest: the body "
            "turns about all of its axes"
        )
        raise InvalidInput(Status.OUT_OF_RANGE, field, told, allowed)
    if least + middle < (1.0 - _PLATE) * largest:
        allowed = "no moment may be larger than the sum of the others: no body has such an inertia"
        raise InvalidInput(Status.OUT_OF_RANGE, field, told, allowed)
    return found


def fastest_turn(inertia: Array, to_inertial: Array, rate: Array) -> float:
    """Return the largest angular velocity of a free body over all time, but for rounding [rad/s].

    With x the squared components about the principal axes, energy and angular momentum conserve
    sum(I x) and sum(I^2 x). The x that fit both are a line segment, as x >= 0, and sum(x) is
    largest at one of its ends.

    Args:
        inertia: About the centre of mass, body axes; only ratios matter. Shape (3, 3).
        to_inertial: Body axes to inertial axes. Shape (3, 3).
        rate: Angular velocity at the same time, inertial axes. Shape (3,) [rad/s].
    """
    moments, axes = np.linalg.eigh(inertia)
    squares = (rate @ (to_inertial @ axes)) ** 2
    along = cross(moments, moments**2)
    along /= max(float(np.abs(along).max()), np.finfo(float).tiny)
    gain = float(along.sum())
    along *= math.copysign(1.0, gain)
    falling = along < 0.0
    # The rotation of a ball is steady, also of one up to rounding.
    way = float((squares[falling] / -along[falling]).min()) if falling.any() else 0.0
    return math.sqrt(float(squares.sum()) + abs(gain) * way)
