"""How far the search for the attitude goes: rounds of initial guesses and hops, as a table.

A deeper search begins with the rounds of the one before, so that it never answers a worse plan.
"""

from __future__ import annotations

from typing import NamedTuple

from ff_planner_ros.planning.problem.settings import SearchDepth


class Round(NamedTuple):
    """Initial guesses that race, and hops from the best path after them."""

    guesses: int
    hops: int


_QUICK, _MORE, _MOST = Round(2, 0), Round(10, 6), Round(16, 48)
ROUNDS = {
    SearchDepth.QUICK: (_QUICK,),
    SearchDepth.NORMAL: (_QUICK, _MORE),
    SearchDepth.THOROUGH: (_QUICK, _MORE, _MOST),
}
# The paper's paths have fewer variables than joint splines: a hop among them costs half as much and
# finds less.
HOPS_OF_PAPERS_PATHS = 3
# Where the attitude is but a minor part of the cost, the first round is the optimum nearest to the
# plan of least joint path.
NEAREST = Round(1, 0)


class RaceStage(NamedTuple):
    """What the paths of a race minimise on the coarsest grid, and how many of them go on.

    The largest of many angles has kinks, a norm of them has not: its first steps lead much further.
    """

    norm: float  # p of the p-norm that stands for the largest angle
    iterations: int
    go_on: int


RACE = (RaceStage(2.0, 14, 4), RaceStage(8.0, 10, 3), RaceStage(float("inf"), 10, 2))
