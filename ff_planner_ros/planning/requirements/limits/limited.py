"""Limits as data: quantities along a motion, what they may be, and one sentence for those beyond.

A start and a plan may exceed a limit by the same `Limit.excess`, a plan by rounding more; the
search keeps the limit itself, but for what the first point exceeds already.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion, Peaks
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    LIMIT_TOLERANCE,
    Assessment,
    Requirement,
    Samples,
    eased,
)

# A quantity further from its limit than this fraction of it cannot reach it in one solver step.
PART_OF_INTEREST = 0.4
# By this part of what is allowed, rounding may raise what the first point has beyond a limit.
_ROUNDING = 1e-2
# Beyond is below a lower limit and above an upper one.
_OUT = np.array([[-1.0], [1.0]])


class Extremes(NamedTuple):
    """Lowest and highest value of each of several quantities along a motion, or bounds of them."""

    values: Array  # shape (2, quantities)
    times: Array  # shape (2, quantities) [s]
    first: Array  # at the first time; shape (quantities,)

    @classmethod
    def of(cls, peaks: Peaks, first: Array) -> Extremes:
        """Return values of largest modulus as extremes; the other one of each is not known."""
        values = np.array([np.minimum(peaks.values, 0.0), np.maximum(peaks.values, 0.0)])
        return cls(values, np.array([peaks.times, peaks.times]), first)


@dataclass(frozen=True, eq=False)
class Limit:
    """Limits of a quantity of several joints or wheels, or of the chaser, and words for them."""

    lower: Array  # shape (quantities,)
    upper: Array  # shape (quantities,)
    subjects: Sequence[str]  # of each quantity: joint elbow
    verb: str  # moves at
    units: Sequence[str]
    advice: Sequence[str]  # to a plan beyond the limits
    name: str = "its limit"
    remarks: Sequence[str] = ()  # on the limit of each quantity; empty: there are none
    status: Status = Status.LIMIT_VIOLATED
    # Largest excess of a start and of a plan, as a fraction of the limit or in its unit; rounding,
    # `LIMIT_TOLERANCE`, is always allowed
    excess: float = ALLOWED_EXCESS
    is_relative: bool = True  # whether excess and slack are fractions of the limit

    def slack(self, found: Extremes) -> float:
        """Return the least distance to the limits, or to what the first point has beyond them."""
        limits = self._kept(found.first)
        left = limits - _OUT * found.values + LIMIT_TOLERANCE
        return float((left / self._unit(limits)).min())

    def certain(self, first: Array) -> Array:
        """Return what bounds of the values, which are a little further out, must be within.

        Args:
            first: Values at the first point. Shape (quantities,).
        """
        return np.asarray(_OUT * (self._kept(first) + self._excess))

    def failures(self, samples: Samples, found: Extremes) -> Iterator[Failure]:
        """Yield the value that is furthest beyond its limit, if that is not allowed."""
        kept = self._kept(found.first) + LIMIT_TOLERANCE
        for side, which in self._beyond(
            found.values, np.maximum(kept, self._limits + self._excess)
        ):
            words = self._words(side, which, found.values[side, which])
            when = samples.at(float(found.times[side, which]))
            yield Failure(self.status, f"{words}, at {when}", tuple(self.advice))

    def refuse_start(
        self, values: Array, fields: Sequence[str], given: Sequence[str], when: str = "at the start"
    ) -> None:
        """Refuse a start beyond the limits.

        Args:
            values: Of the quantities. Shape (quantities,), or lowest and highest ones that follow,
                (2, quantities).
            fields: Those of the start that the values follow from: one, or one a quantity.
            given: What they are, in words.
            when: Begins the sentence.

        Raises:
            InvalidInput: A value is further beyond its limit than is allowed.
        """
        values = np.broadcast_to(values, self._limits.shape)
        for side, which in self._beyond(values, self._limits + self._excess):
            at = which % len(fields)
            words = f"{when} {self._words(side, which, values[side, which])}"
            raise InvalidInput(Status.START_OUTSIDE_LIMITS, fields[at], given[at], words)

    @property
    def _limits(self) -> Array:
        """Both limits, growing outward. Shape (2, quantities)."""
        return np.array([-self.lower, self.upper])

    @property
    def _excess(self) -> Array:
        return np.maximum(self.excess * self._unit(self._limits), LIMIT_TOLERANCE)

    def _kept(self, first: Array) -> Array:
        """Return the limits, or what an allowed first point has beyond them, growing outward."""
        return eased(self._limits, _OUT * first, (1.0 + _ROUNDING) * self._excess)

    def _unit(self, limits: Array) -> Array:
        """Return the unit of excess and slack."""
        is_part = np.isfinite(limits) & self.is_relative
        return np.where(is_part, np.abs(limits), 1.0)

    def _beyond(self, values: Array, allowed: Array) -> Iterator[tuple[int, int]]:
        """Yield side and number of the value that exceeds its limit by most, if one may not."""
        is_allowed = _OUT * values <= allowed
        if not is_allowed.all():
            parts = (_OUT * values - self._limits) / self._unit(self._limits)
            most = np.where(is_allowed, -np.inf, parts).argmax()
            side, which = np.unravel_index(most, parts.shape)
            yield int(side), int(which)

    def _words(self, side: int, which: int, value: float) -> str:
        """Return the sentence for a value beyond its limit."""
        limit, unit = (self.lower, self.upper)[side][which], self.units[which]
        excess = abs(value - limit)
        if self.lower[which] == -self.upper[which]:  # what is limited is the size
            limit = abs(limit)
        return (
            f"{self.subjects[which]} {self.verb} {value:.5g} {unit}, {excess:.3g} {unit} beyond "
            f"{self.name} of {limit:g} {unit}{self.remarks[which] if self.remarks else ''}"
        )


class Limited(Requirement):
    """A requirement that quantities stay within limits along the whole motion.

    From limits and extremes follow slack, failures and words.
    """

    # The search stays so far from the limits at the points, in the unit of the slack: between 50
    # points quantities rise above what the search knows by less
    kept: ClassVar[float] = 1e-3
    # Metrics that are the largest sizes of the quantities of each limit, and whether each is a
    # tuple with one value for each of them
    sizes: ClassVar[Sequence[str]] = ()
    of_each: ClassVar[bool] = False

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limits of one or more quantities; empty: there are none."""
        raise NotImplementedError

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the extremes of the quantities of each limit along a motion.

        Values that are within their limits may be bounds of them.
        """
        raise NotImplementedError

    def metrics(
        self, problem: PlanningProblem, motion: FollowedMotion, found: Sequence[Extremes]
    ) -> Mapping[str, Any]:
        """Return metrics by their names in `METRICS`: those in `sizes`, of the extremes."""
        peaks = (np.abs(extremes.values).max(axis=0).tolist() for extremes in found)
        return {
            name: tuple(peak) if self.of_each else peak[0]
            for name, peak in zip(self.sizes, peaks, strict=False)
        }

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays, in the unit of the slack."""
        return self.kept

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are limits."""
        return bool(self.limits(problem))

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance to a limit, or a positive bound below it."""
        limits = self.limits(problem)
        if not limits:
            return np.inf
        found = self.extremes(problem, motion)
        return min(limit.slack(extremes) for limit, extremes in zip(limits, found, strict=True))

    def assess(self, samples: Samples) -> Assessment:
        """Return the metrics, and of each limit the value that is furthest beyond."""
        problem, motion = samples.problem, samples.followed
        found = self.extremes(problem, motion)
        failures = [
            failure
            # Without limits there may be extremes, for metrics.
            for limit, extremes in zip(self.limits(problem), found, strict=False)
            for failure in limit.failures(samples, extremes)
        ]
        return Assessment(self.metrics(problem, motion, found), failures)
