"""The depth of the attitude search: its rounds of initial guesses and basin hops, as a table.

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
ROUNDS = {
    SearchDepth.QUICK: (_QUICK,),
    SearchDepth.NORMAL: (_QUICK, _MORE),
    SearchDepth.THOROUGH: (_QUICK, _MORE, _MOST),
}
# Factor on the hops: the paper's paths have fewer variables than joint splines, so that a hop costs
# half as much and finds less.
HOPS_OF_PAPERS_PATHS = 3
# First round if the attitude is a minor part of the cost: the optimum nearest to the plan of
# minimum joint path.
NEAREST = Round(1, 0)


class RaceStage(NamedTuple):
    """One stage of successive halving on the coarsest grid.

    The largest of many angles has kinks, a p-norm has none: first steps on it lead much further.
    """

    norm: float  # p of the p-norm that stands for the largest angle
    iterations: int
    go_on: int


RACE = (RaceStage(2.0, 14, 4), RaceStage(8.0, 10, 3), RaceStage(float("inf"), 10, 2))
