"""The robot's bodies stay clear of spheres and of each other, between the points too.

This is for robots with collision geometry; `Clearance` is for centre lines.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.distance.allowed_contact import (
    may_touch,
    split_pairs,
    split_spheres,
    stretches,
)
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_certificate import (
    least_pair_distance,
    least_sphere_distance,
)
from ff_planner_ros.planning.distance.body_distances import sphere_bounds, sphere_distances
from ff_planner_ros.planning.distance.certificate import certificate_gap
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.distance.contact import deepest_contact, way_out
from ff_planner_ros.planning.distance.search_certificate import (
    search_distance,
    search_pair_distance,
)
from ff_planner_ros.planning.distance.start_room import LEAST_CLEARANCE, room_of_bodies
from ff_planner_ros.planning.motion.certified_least import NOTHING, Least, least_of
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.paths.start_approach import NEAR, refuse_bodies_approached
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.body_rows import (
    obstacles_in_core,
    pairs_in_core,
)
from ff_planner_ros.planning.requirements.collisions import (
    SLACK_PART,
    KeptClear,
    collision,
    detours,
    refuse_nearness,
)
from ff_planner_ros.planning.requirements.obstacle_clearance import (
    body_and_obstacle,
    least_from_obstacles,
)
from ff_planner_ros.planning.requirements.requirement import (
    Assessment,
    Samples,
    elsewhere,
)


class BodyClearance(KeptClear):
    """Every body stays outside every sphere."""

    name = "body_clearance"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start in contact, or with a body that moves into a sphere whatever follows."""
        contact = deepest_contact(problem, q_start, within=LEAST_CLEARANCE)
        if contact is None:
            _refuse_approached(problem, q_start)
            return
        out = way_out(problem, q_start, contact, LEAST_CLEARANCE)
        if contact.obstacle:
            refuse_nearness(contact.second, contact.first, contact.distance, "robot", out)
        raise InvalidInput(
            Status.START_IN_COLLISION,
            "joints.position",
            f"with {contact.first} in {contact.second}, {-contact.distance:.4f} m deep",
            f"at the start the robot must touch neither an obstacle nor itself{out}",
        )

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are bodies and spheres."""
        return bool(problem.robot.bodies and problem.spheres)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        room, split = room_of_bodies(problem), split_spheres(problem)
        return (obstacles_in_core(problem, problem.spheres, points, margin, room, split),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified clearance [m]."""
        robot, spheres = problem.robot, problem.spheres
        if not (robot.bodies and spheres):
            return np.inf
        gap = certificate_gap(problem)
        return min(
            search_distance(robot, part, spheres, chosen, last, SLACK_PART, gap)
            for part, chosen, last in stretches(problem, motion, split_spheres(problem))
        )

    def assess(self, samples: Samples) -> Assessment:
        """Return the certified clearance from obstacles [m], its pair and its time [s].

        The failure is the deepest collision with a sphere.
        """
        problem = samples.problem
        if not problem.robot.bodies:
            return Assessment()
        spheres = _from_spheres(problem, samples.followed)
        others = least_from_obstacles(problem, samples.followed)
        least = least_of(spheres, others)
        names = (
            _body_and_sphere(problem, least)
            if spheres.found <= others.found
            else body_and_obstacle(problem, least)
        )
        found = {
            "min_clearance": least.certified,
            "min_clearance_pair": "/".join(names),
            "min_clearance_time": least.time,
        }
        if spheres.certified >= 0.0:
            return Assessment(found)
        body, sphere = _body_and_sphere(problem, spheres)
        failure = collision(samples, spheres, body, f"obstacle {sphere}", detours(problem))
        return Assessment(found, (failure,))


class SelfClearance(KeptClear):
    """The robot's own bodies do not collide: no pair of `robot.pairs` touches."""

    name = "self_clearance"

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
        """Return the certified clearance between bodies [m], its pair and its time [s]."""
        problem = samples.problem
        least = _of_pairs(problem, samples.followed)
        pair = _two_bodies(problem, least)
        found = {
            "min_self_clearance": least.certified,
            "min_self_clearance_pair": "/".join(pair),
            "min_self_clearance_time": least.time,
        }
        if least.certified >= 0.0:
            return Assessment(found)
        advice = elsewhere(problem), "a longer duration", "more planner.starts"
        first, second = pair
        return Assessment(found, (collision(samples, least, first, second, advice),))


def _from_spheres(problem: PlanningProblem, motion: FollowedMotion) -> Least:
    """Return the least distance of any body from any sphere where they must not touch."""
    robot, spheres = problem.robot, problem.spheres
    if not (robot.bodies and spheres):
        return NOTHING
    gap = certificate_gap(problem)
    return least_of(
        *(
            least_sphere_distance(robot, part, spheres, chosen, last, gap=gap)
            for part, chosen, last in stretches(problem, motion, split_spheres(problem))
        )
    )


def _of_pairs(problem: PlanningProblem, motion: FollowedMotion) -> Least:
    """Return the least distance of any pair of bodies that must not touch."""
    if not problem.robot.pairs:
        return NOTHING
    return least_of(
        *(
            least_pair_distance(problem.robot, part, chosen, last)
            for part, chosen, last in stretches(problem, motion, split_pairs(problem))
        )
    )


def _refuse_approached(problem: PlanningProblem, q_start: Array) -> None:
    """Refuse a start with a body that moves into a sphere whatever follows."""
    robot, spheres = problem.robot, problem.spheres
    if not (robot.bodies and spheres):
        return
    radius = np.array([sphere.radius for sphere in spheres])

    def seen(q: Array, times: Array) -> Array:
        return centers_in_base(q, centers_at(times, spheres))

    bounds = sphere_bounds(
        robot, placed_bodies(robot, q_start[None, 7:]), seen(q_start[None], np.zeros(1)), radius
    )
    near = bounds[0] < NEAR
    near.reshape(-1)[may_touch(problem, split_spheres(problem), q_start, 0.0)] = False

    def distances(q: Array, times: Array, rows: tuple[Indices, ...]) -> Array:
        placed = placed_bodies(robot, q[:, 7:])
        return sphere_distances(robot, placed, seen(q, times), radius, rows).distance

    refuse_bodies_approached(problem, near, distances, [sphere.id for sphere in spheres])


def _body_and_sphere(problem: PlanningProblem, least: Least) -> tuple[str, ...]:
    """Return the names of both; nothing where nothing was met."""
    if least.number < 0:
        return ()
    body, sphere = divmod(least.number, len(problem.spheres))
    return problem.robot.bodies[body].name, problem.spheres[sphere].id


def _two_bodies(problem: PlanningProblem, least: Least) -> tuple[str, ...]:
    if least.number < 0:
        return ()
    return tuple(problem.robot.bodies[body].name for body in problem.robot.pairs[least.number])
