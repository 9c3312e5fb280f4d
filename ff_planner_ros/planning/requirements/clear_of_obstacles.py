"""The robot stays outside every obstacle, between the points too: its bodies, or its centre lines.

The summed penalty R_obst = 0 of the paper, Eq. (43), has no gradient on its feasible side. The
distances themselves are constrained instead, which says the same. The distance of separate convex
solids has one normal, which changes smoothly with their poses; only the nearest points of parallel
faces and edges jump as they rotate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.distance.allowed_contact import (
    certificate_gap,
    split_obstacles,
    stretches,
)
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP, least_obstacle_distance
from ff_planner_ros.planning.distance.clearance import clearances, penalty, segments
from ff_planner_ros.planning.distance.contact import deepest_contact, way_out
from ff_planner_ros.planning.distance.search_certificate import CERTIFICATE_GAP, search_distance
from ff_planner_ros.planning.distance.start_room import (
    CLEARANCE_AT_END,
    LEAST_CLEARANCE,
)
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.motion.certified_least import NOTHING, Least, least_of
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.paths.start_approach import refuse_approached
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.body_rows import obstacles_in_core
from ff_planner_ros.planning.requirements.collisions import SLACK_PART, KeptClear, collision
from ff_planner_ros.planning.requirements.requirement import Assessment, Samples, elsewhere
from ff_planner_ros.robot.collision.lines import in_words, with_bodies


class ClearOfObstacles(KeptClear):
    """Every body, or centre line, stays outside every obstacle."""

    name = "clear_of_obstacles"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start in contact, also with itself, or moving into an obstacle in any plan."""
        contact = deepest_contact(problem, q_start, within=LEAST_CLEARANCE)
        if contact is None:
            refuse_approached(problem, q_start)
            return
        out, touch = way_out(problem, q_start, contact, LEAST_CLEARANCE), Status.START_IN_COLLISION
        if not contact.obstacle:
            deep = f"with {contact.first} in {contact.second}, {-contact.distance:.4f} m deep"
            allowed = "at the start the robot must touch neither an obstacle nor itself"
            raise InvalidInput(touch, "joints.position", deep, allowed + out)
        part = "robot" if problem.robot.bodies else "arm"
        value = f"around {contact.first}, {-contact.distance:.4f} m deep"
        allowed = f"at the start the {part} must be outside every obstacle"
        if contact.distance > 0.0:
            value = f"{contact.distance * 1e3:.4f} mm from {contact.first}"
            allowed = (
                f"a start needs a clearance of {LEAST_CLEARANCE * 1e3:g} mm from every obstacle; "
                "start further away"
            )
        raise InvalidInput(touch, f"obstacles[{contact.second}]", value, allowed + out)

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are obstacles."""
        return bool(problem.obstacles)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        return (obstacles_in_core(problem, points, margin),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified clearance [m]."""
        robot, obstacles = with_bodies(problem.robot), problem.obstacles
        if not obstacles:
            return np.inf
        gap = certificate_gap(problem, CERTIFICATE_GAP)
        return min(
            search_distance(robot, part, obstacles, chosen, last, SLACK_PART, gap)
            for part, chosen, last in stretches(problem, motion, split_obstacles(problem))
        )

    def assess(self, samples: Samples) -> Assessment:
        """Return R_obst and the certified clearance [m] with its pair and its time [s].

        The failures are the deepest collision, and an obstacle that the last point is too near to.
        """
        problem, least = samples.problem, _least(samples.problem, samples.followed)
        body, obstacle = divmod(least.number, max(len(problem.obstacles), 1))
        found: dict[str, float | str] = {
            "penalty": _penalty(samples),
            "min_clearance": least.certified,
            "min_clearance_pair": "",
            "min_clearance_time": least.time,
        }
        failures = list[Failure]()
        if least.number >= 0:
            robot, one = with_bodies(problem.robot), problem.obstacles[obstacle]
            found["min_clearance_pair"] = f"{robot.bodies[body].name}/{one.id}"
            if least.certified < 0.0:
                names = in_words(problem.robot, body), f"obstacle {one.id}"
                failures.append(collision(samples, least, names, _detours(problem)))
        if least.certified < CLEARANCE_AT_END:
            failures += _too_near_at_end(samples)
        return Assessment(found, failures)


def _penalty(samples: Samples) -> float:
    """Return R_obst, which spheres alone count for, as in the paper."""
    arm, times, settings = samples.arm, samples.trajectory.time, samples.settings
    around = surroundings(samples.problem.obstacles)
    low, high, centers = arm.min(axis=(0, 1)), arm.max(axis=(0, 1)), around.centers(times)
    beyond = np.maximum(np.maximum(low - centers, centers - high), 0.0)
    is_near = (np.linalg.norm(beyond, axis=2) <= around.radii).any(axis=0)
    spheres = [around.obstacles[k] for k in np.flatnonzero(is_near & around.are_spheres).tolist()]
    found = clearances(arm, times, segments(arm), spheres)
    return penalty(found.distance, settings.penalty_gain, settings.penalty_exponent)


def _least(problem: PlanningProblem, motion: FollowedMotion) -> Least:
    """Return the least distance from obstacles, without allowed contacts."""
    robot, around = with_bodies(problem.robot), surroundings(problem.obstacles)
    if not problem.obstacles:
        return NOTHING
    gap = certificate_gap(problem, CHECK_GAP)
    return least_of(
        *(
            least_obstacle_distance(robot, part, around, chosen, last, gap)
            for part, chosen, last in stretches(problem, motion, split_obstacles(problem))
        )
    )


def _too_near_at_end(samples: Samples) -> Iterator[Failure]:
    """Yield the obstacle that the last point, where another plan may start, is too near to."""
    problem, end = samples.problem, float(samples.trajectory.time[-1])
    near = deepest_contact(problem, samples.q[-1], end, CLEARANCE_AT_END)
    if near is not None and near.obstacle and near.distance > 0.0:  # else reported elsewhere
        yield Failure(
            Status.COLLISION,
            f"at its last point {near.first} is {near.distance * 1e3:.4f} mm from obstacle "
            f"{near.second}, where {CLEARANCE_AT_END * 1e3:g} mm are needed so that another plan "
            "may start there",
            (elsewhere(problem), "a larger planner.clearance_margin"),
        )


def _detours(problem: PlanningProblem) -> tuple[str, ...]:
    """Return advice for a body that is in an obstacle on the way."""
    posture = problem.posture
    ends = "" if posture is not None and posture.at_rest else "goal or "
    aside = f"a {ends}start posture on another side of the obstacle"
    return "a longer duration", aside, "more planner.starts"
