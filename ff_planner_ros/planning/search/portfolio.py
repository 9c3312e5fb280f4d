"""The depth of the attitude search: its rounds of initial guesses and basin hops, as tables.

A deeper search begins with the rounds of the shallower one, so that its plan is never worse.
"""

from __future__ import annotations

from typing import NamedTuple

from ff_planner_ros.planning.problem.settings import SearchDepth


class Round(NamedTuple):
    """Number of initial guesses for successive halving, and of basin hops after it."""

    guesses: int
    hops: int


_QUICK, _MORE, _MOST = Round(2, 0), Round(10, 6), Round(16, 48)
_ROUNDS = {
    SearchDepth.QUICK: (_QUICK,),
    SearchDepth.NORMAL: (_QUICK, _MORE),
    SearchDepth.THOROUGH: (_QUICK, _MORE, _MOST),
}
# Factor on the hops: the paper's paths have fewer variables than joint splines, so that a hop costs
# half as much and finds less.
HOPS_OF_PAPERS_PATHS = 3
# First round if the attitude is a minor part of the cost: the optimum nearest to the plan of
# minimum joint path.
_NEAREST = Round(1, 0)
# Shares of the attitude in the cost of that plan. Below the first, no other guesses are tried; up
# to the second, only if there is something to gain.
_NEGLIGIBLE, MINOR = 2e-4, 0.3


def rounds_of(depth: SearchDepth, attitude_share: float) -> tuple[Round, ...]:
    """Return the rounds of a search, by the share of the attitude in the cost."""
    if attitude_share <= _NEGLIGIBLE:
        return (_NEAREST,)
    rounds = _ROUNDS[depth]
    return (_NEAREST, *rounds[1:]) if attitude_share <= MINOR else rounds


class RaceStage(NamedTuple):
    """One stage of successive halving on the coarsest grid.

    The largest of many angles has kinks, a p-norm has none: first steps on it lead much further.
    """

    norm: float  # p of the p-norm that stands for the largest angle
    iterations: int
    go_on: int


RACE = (RaceStage(2.0, 14, 4), RaceStage(8.0, 10, 3), RaceStage(float("inf"), 10, 2))
# Iterations from a survivor of successive halving to its optimum on the coarsest grid.
TO_OPTIMUM = 24
# Basin hops from the best path: random steps along each direction, of these two standard deviations
# in turn, for so many iterations. One whose objective is below so many times the best is optimised.
SPREADS, AFTER_HOP, NEARLY = (0.1, 0.2), 14, 1.3
# Hops that begin at the same optimum. One after another, each from the best, found no better ones.
HOPS_AT_ONCE = 6
# Iterations of a first look on all points: with it, a budget of 0.2 s was enough for a better
# attitude in 19 of 20 problems, without it in 8; the whole search takes 20 ms longer.
GLANCE = 4
