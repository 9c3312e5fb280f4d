"""Quintic B-splines in time: the functions that joint splines are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices

DEGREE = 5
# Start angle, rate and acceleration fix so many control points, the first ones.
FIXED = 3


@dataclass(frozen=True)
class SplineBasis:
    """The quintic B-splines on equal spans of a duration; the motion's jerk is continuous."""

    duration: float  # [s]
    spans: int

    @property
    def count(self) -> int:
        """Number of control points."""
        return self.spans + DEGREE

    def rows(self, s: Array, order: int = 0) -> Array:
        """Return the matrix from control points to a derivative by time, at normalised times s.

        Shape (times, control points) [1/s^order].
        """
        first = np.searchsorted(self.knots[DEGREE + 1 : self.count], s, side="right")
        rows = np.zeros((len(s), self.count))
        for number, values in enumerate(_splines_at(s, self.knots, first, order)):
            rows[np.arange(len(s)), first + number] = values
        return rows / self.duration**order

    def on_grid(self, points: int, order: int = 0) -> Array:
        """Return `rows` at so many equally spaced times from start to end, computed once."""
        return np.asarray(_on_grid(self.spans, points, order) / self.duration**order, np.float64)

    def start(self, positions: Array, rates: Array, accelerations: Array) -> Array:
        """Return the first control points of a spline that begins so. Shape (3, joints)."""
        at_start = np.array([self.on_grid(1, order)[0, :FIXED] for order in range(3)])
        fixed: Array = np.linalg.solve(at_start, np.array([positions, rates, accelerations]))
        return fixed

    def end(self, positions: Array, rates: Array, accelerations: Array) -> Array:
        """Return the last control points of a spline that ends so. Shape (3, joints)."""
        at_end = np.array([self.on_grid(2, order)[1, -FIXED:] for order in range(3)])
        fixed: Array = np.linalg.solve(at_end, np.array([positions, rates, accelerations]))
        return fixed

    def hull(self, order: int = 0) -> Array:
        """Return the matrix from control points to points whose range bounds a derivative.

        They are the control points of the same derivative on half spans: no value of it is outside
        their range, and they are four times nearer to it than those on whole spans. Shape
        (points, control points) [1/s^order].
        """
        knots, points = _finer(self.spans)
        for lower in range(order):
            degree = DEGREE - lower
            inner = knots[lower : len(knots) - lower]
            width = self.duration * (inner[degree + 1 : -1] - inner[1 : -1 - degree])
            points = degree * np.diff(points, axis=0) / width[:, None]
        return np.asarray(points, np.float64)

    @cached_property
    def knots(self) -> Array:
        """Knots of a duration of 1 s, those at the ends six times. Shape (control points + 6,)."""
        ends = np.zeros(DEGREE), np.ones(DEGREE)
        return np.concatenate([ends[0], np.linspace(0.0, 1.0, self.spans + 1), ends[1]])


def _splines_at(s: Array, knots: Array, first: Indices, order: int) -> list[Array]:
    """Return a derivative of the splines that are not zero at times s, one after the other.

    De Boor's recursion over the degree; that of the derivative for the last degrees.

    Args:
        first: Number of the first of them for each of the times.
    """
    splines = [np.ones(len(s))]
    for degree in range(1, DEGREE + 1):
        lower, splines = splines, [np.zeros(len(s))]
        for number, one in enumerate(lower):
            begin, end = (knots[first + DEGREE + number + k] for k in (1 - degree, 1))
            if degree <= DEGREE - order:
                share = one / (end - begin)
                splines[-1] += share * (end - s)
                splines.append(share * (s - begin))
            else:
                share = degree * one / (end - begin)
                splines[-1] -= share
                splines.append(share)
    return splines


@lru_cache(maxsize=64)
def _on_grid(spans: int, points: int, order: int) -> Array:
    """Return `SplineBasis.on_grid` of a duration of 1 s."""
    return SplineBasis(1.0, spans).rows(np.linspace(0.0, 1.0, points), order)


@lru_cache(maxsize=8)
def _finer(spans: int) -> tuple[Array, Array]:
    """Return the knots of half spans, and the matrix from control points to those on half spans."""
    basis, finer = SplineBasis(1.0, spans), SplineBasis(1.0, 2 * spans)
    knots = finer.knots
    # Both splines are the same function, and so they agree at the Greville abscissae.
    at = np.array([knots[k + 1 : k + 1 + DEGREE].mean() for k in range(finer.count)])
    return knots, np.asarray(np.linalg.solve(finer.rows(at), basis.rows(at)), np.float64)
