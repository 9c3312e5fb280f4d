"""The robot stays outside convex obstacles other than spheres, between the points too.

Its bodies do, or its centre lines. The distance of separate convex solids has one normal, which
changes smoothly with their poses; only the nearest points of parallel faces and edges jump as they
rotate, as for the robot's own pairs. Spheres have requirements of their own: their distances have
closed forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.distance.allowed_contact import may_touch, split_obstacles, stretches
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.distance.body_certificate import least_obstacle_distance
from ff_planner_ros.planning.distance.certificate import certificate_gap
from ff_planner_ros.planning.distance.obstacle_distances import (
    obstacle_bounds,
    obstacle_distances,
    seen_from_chaser,
)
from ff_planner_ros.planning.distance.search_certificate import search_distance
from ff_planner_ros.planning.distance.start_room import room_of_obstacles
from ff_planner_ros.planning.motion.certified_least import NOTHING, Least, least_of
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.paths.start_approach import NEAR, refuse_bodies_approached
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.body_rows import obstacles_in_core
from ff_planner_ros.planning.requirements.collisions import (
    SLACK_PART,
    KeptClear,
    collision,
    detours,
)
from ff_planner_ros.planning.requirements.requirement import Assessment, Samples
from ff_planner_ros.robot.collision.lines import with_bodies


class ObstacleClearance(KeptClear):
    """Every body, or centre line, stays outside every obstacle that is not a sphere."""

    name = "obstacle_clearance"

    def refuse(self, problem: PlanningProblem) -> None:
        """Refuse centre lines along which a prismatic joint moves: a body has one length."""
        robot, obstacles = problem.robot, problem.obstacle_bodies
        if obstacles and not robot.bodies and robot.joint_slides[1:].any():
            allowed = (
                "with lines every obstacle must be a sphere where a joint slides along the arm; "
                "robot.geometry must be shapes"
            )
            told = f"obstacles[{obstacles[0].id}].shape"
            raise InvalidInput(Status.UNSUPPORTED, told, "no sphere", allowed)

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start that moves into an obstacle; `BodyClearance` refuses one that is in it."""
        obstacles = problem.obstacle_bodies
        if not obstacles:
            return
        robot = with_bodies(problem.robot)
        placed, now = placed_bodies(robot, q_start[None, 7:]), np.zeros(1)
        near = obstacle_bounds(robot, placed, q_start[None], now, obstacles)[0] < NEAR
        near.reshape(-1)[may_touch(problem, split_obstacles(problem), q_start, 0.0)] = False

        def distances(q: Array, times: Array, rows: tuple[Indices, ...]) -> Array:
            placed, poses = placed_bodies(robot, q[:, 7:]), seen_from_chaser(q, times, obstacles)
            return obstacle_distances(robot, placed, poses, obstacles, rows).distance

        refuse_bodies_approached(problem, near, distances, [one.id for one in obstacles])

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are such obstacles."""
        return bool(problem.obstacle_bodies)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        room, split = room_of_obstacles(problem), split_obstacles(problem)
        return (obstacles_in_core(problem, problem.obstacle_bodies, points, margin, room, split),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified clearance [m]."""
        robot, obstacles = with_bodies(problem.robot), problem.obstacle_bodies
        if not obstacles:
            return np.inf
        gap = certificate_gap(problem)
        return min(
            search_distance(robot, part, obstacles, chosen, last, SLACK_PART, gap)
            for part, chosen, last in stretches(problem, motion, split_obstacles(problem))
        )

    def assess(self, samples: Samples) -> Assessment:
        """Return the failure of the deepest collision."""
        problem = samples.problem
        least = least_from_obstacles(problem, samples.followed)
        if least.certified >= 0.0:
            return Assessment()
        body, obstacle = body_and_obstacle(problem, least)
        failure = collision(samples, least, body, f"obstacle {obstacle}", detours(problem))
        return Assessment(failures=(failure,))


@lru_cache(maxsize=4)
def least_from_obstacles(problem: PlanningProblem, motion: FollowedMotion) -> Least:
    """Return the least distance from obstacles other than spheres, without allowed contacts.

    Its pair is numbered as by `least_obstacle_distance`.
    """
    robot, obstacles = with_bodies(problem.robot), problem.obstacle_bodies
    if not obstacles:
        return NOTHING
    gap = certificate_gap(problem)
    return least_of(
        *(
            least_obstacle_distance(robot, part, obstacles, chosen, last, gap=gap)
            for part, chosen, last in stretches(problem, motion, split_obstacles(problem))
        )
    )


def body_and_obstacle(problem: PlanningProblem, least: Least) -> tuple[str, ...]:
    """Return the names of body and obstacle of a least distance; empty if it has no pair."""
    if least.number < 0:
        return ()
    body, obstacle = divmod(least.number, len(problem.obstacle_bodies))
    return with_bodies(problem.robot).bodies[body].name, problem.obstacle_bodies[obstacle].id
