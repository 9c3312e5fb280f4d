"""The robot's own bodies do not collide, between the points too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.core import compiled
from ff_planner_ros.planning.distance.allowed_contact import split_pairs, stretches
from ff_planner_ros.planning.distance.body_certificate import least_pair_distance
from ff_planner_ros.planning.distance.search_certificate import search_pair_distance
from ff_planner_ros.planning.motion.certified_least import NOTHING, least_of
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.body_rows import pairs_in_core
from ff_planner_ros.planning.requirements.collisions import SLACK_PART, KeptClear, collision
from ff_planner_ros.planning.requirements.requirement import Assessment, Samples, elsewhere


class ClearOfItself(KeptClear):
    """No pair of `robot.pairs` touches."""

    name = "clear_of_itself"

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are pairs that must not touch."""
        return bool(problem.robot.pairs)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        return (pairs_in_core(problem, points, margin),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified clearance [m]."""
        if not self.concerns(problem):
            return np.inf
        return min(
            search_pair_distance(problem.robot, part, chosen, last, SLACK_PART)
            for part, chosen, last in stretches(problem, motion, split_pairs(problem))
        )

    def assess(self, samples: Samples) -> Assessment:
        """Return the certified clearance between bodies [m], its pair and its time [s].

        The failure is the deepest collision.
        """
        problem, robot, least = samples.problem, samples.problem.robot, NOTHING
        if robot.pairs:
            parts = stretches(problem, samples.followed, split_pairs(problem))
            least = least_of(*(least_pair_distance(robot, *part) for part in parts))
        pair = robot.pairs[least.number] if least.number >= 0 else ()
        names = [robot.bodies[body].name for body in pair]
        found = {
            "min_self_clearance": least.certified,
            "min_self_clearance_pair": "/".join(names),
            "min_self_clearance_time": least.time,
        }
        if least.certified >= 0.0:
            return Assessment(found)
        advice = elsewhere(problem), "a longer duration", "more planner.starts"
        return Assessment(found, (collision(samples, least, names, advice),))
