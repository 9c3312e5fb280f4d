"""The least of several values along a motion, certified between the times at which they are known.

A value that changes by no more than its way is nowhere below the mean of those at both ends less
half of the way. And it is not below an arc that is nowhere above it: a function of which the values
at both ends and a bound of the second derivative are known. Pieces of the motion whose better bound
is too low to decide are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices

# Pieces that are looked at: a motion that needs more, nothing makes, and the bound is lower.
MOST_PIECES = 1 << 16
# Where pieces are cut: fewer calls for more values at once cost less than with two halves.
_CUTS = np.array([[0.25], [0.5], [0.75]])
_TINY = np.finfo(float).tiny
Rows: TypeAlias = Indices | NDArray[np.bool_] | slice


class Known(NamedTuple):
    """Values, one a row, and what arcs need of them."""

    value: Array  # shape (rows,)
    more: tuple[Array, ...] = ()  # each of shape (rows, ...)

    def rows(self, which: Rows) -> Known:
        """Return some of the rows."""
        return Known(self.value[which], tuple(each[which] for each in self.more))

    def followed_by(self, others: Known) -> Known:
        """Return these rows, then others."""
        return Known(
            np.concatenate([self.value, others.value]),
            tuple(np.concatenate(both) for both in zip(self.more, others.more, strict=True)),
        )


class Pieces(NamedTuple):
    """Pieces of a motion, each of one value. A step counts points, and parts between two."""

    which: Indices  # number of the value; shape (pieces,)
    begin: Array  # first step; shape (pieces,)
    end: Array  # last step; a piece that crosses a point begins and ends at points
    at_begin: Known
    at_end: Known

    def rows(self, which: Rows) -> Pieces:
        """Return some of the pieces."""
        ends = self.at_begin.rows(which), self.at_end.rows(which)
        return Pieces(self.which[which], self.begin[which], self.end[which], *ends)

    def divided(self, cuts: Array, at_cuts: Known) -> Pieces:
        """Return all parts of each piece.

        Args:
            cuts: Steps between them. Shape (cuts, pieces).
            at_cuts: A row a cut and piece, pieces running fastest.
        """
        count, parts = len(self.which), len(cuts) + 1
        begin, end = np.vstack([self.begin, cuts]), np.vstack([cuts, self.end])
        every = self.at_begin.followed_by(at_cuts).followed_by(self.at_end)
        first, last = every.rows(slice(-count)), every.rows(slice(count, None))
        return Pieces(np.tile(self.which, parts), begin.ravel(), end.ravel(), first, last)


class Arcs(NamedTuple):
    """Functions that are nowhere above the value on a piece. Each of shape (arcs, pieces)."""

    at_begin: Array
    at_end: Array
    bend: Array  # second derivative at most, by the part of the piece; not negative


class Least(NamedTuple):
    """The least of values along a motion."""

    certified: float  # lower bound at all times
    found: float  # the least that was evaluated
    number: int  # of that value; -1: there is none
    time: float  # when [s]
    more: tuple[Array, ...] = ()  # what else is known of it then


NOTHING = Least(np.inf, np.inf, -1, np.inf)


def least_of(*every: Least) -> Least:
    """Return the nearest of several, with the lowest bound of all."""
    nearest = min(every, key=lambda least: least.found)
    return nearest._replace(certified=min(least.certified for least in every))


def certified_least(
    times: Array,
    pieces: Pieces,
    values_at: Callable[[Array, Indices], Known],
    ways: Callable[[Pieces], Array],
    arcs: Callable[[Pieces], Arcs] | None,
    gap: float,
    part: float = 0.0,
) -> Least:
    """Return the least value on pieces of a motion, and a lower bound of it.

    Args:
        times: Of the points of the motion. Shape (points,) [s].
        pieces: One or more.
        values_at: Returns values at steps, of the number that is given for each.
        ways: Returns how far values change at most on pieces.
        arcs: Returns arcs for pieces between two points. None: there are none.
        gap: The bound is below the least by this at most, unless `MOST_PIECES` are too few; or, if
            that is more,
        part: by this fraction of it.
    """
    best = _least_of(pieces.which, pieces.begin, pieces.at_begin, times)
    at_end = _least_of(pieces.which, pieces.end, pieces.at_end, times)
    best = at_end if at_end.found < best.found else best
    certified, looked_at = best.found, 0
    while True:
        enough = best.found - max(gap, part * best.found)
        bound = (pieces.at_begin.value + pieces.at_end.value - ways(pieces)) / 2
        short = np.flatnonzero((bound < enough) & (pieces.end - pieces.begin <= 1.0))
        if arcs is not None and short.size:
            lowest = parabola_bounds(*arcs(pieces.rows(short))).max(axis=0)
            bound[short] = np.maximum(bound[short], lowest)
        is_open = (bound < enough) & (looked_at < MOST_PIECES)
        looked_at += len(bound)
        certified = min(certified, float(bound[~is_open].min(initial=np.inf)))
        if not is_open.any():
            return best._replace(certified=certified)
        pieces = pieces.rows(is_open)
        length = pieces.end - pieces.begin
        cuts = pieces.begin + _CUTS * length
        cuts = np.where(length > 2.0, np.floor(cuts), cuts)
        at_cuts = values_at(cuts.ravel(), np.tile(pieces.which, len(cuts)))
        if at_cuts.value.min() < best.found:
            which = np.tile(pieces.which, len(cuts))
            best = _least_of(which, cuts.ravel(), at_cuts, times)
            certified = min(certified, best.found)
        pieces = pieces.divided(cuts, at_cuts)


def _least_of(which: Indices, steps: Array, known: Known, times: Array) -> Least:
    """Return the least of known values, at steps; nothing is certified yet."""
    row = int(known.value.argmin())
    time = float(np.interp(steps[row], np.arange(len(times)), times))
    more = tuple(each[row] for each in known.more)
    return Least(-np.inf, float(known.value[row]), int(which[row]), time, more)


def parabola_bounds(at_begin: Array, at_end: Array, bend: Array) -> Array:
    """Return the least values, from begin to end, of parabolas through values at both.

    Args:
        at_begin: Values at the begin. Any shape.
        at_end: As at_begin.
        bend: Second derivative by the part of the way, not negative. Same shape.
    """
    rise, bend = at_end - at_begin, bend + _TINY
    with np.errstate(over="ignore"):
        vertex = (at_begin + at_end) / 2 - bend / 8 - rise * (rise / bend) / 2
    return np.where(2 * np.abs(rise) < bend, vertex, np.minimum(at_begin, at_end))
