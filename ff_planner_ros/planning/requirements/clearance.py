"""The arm's centre lines stay outside every sphere, between the points too.

The summed penalty R_obst = 0 of the paper, Eq. (43), has no gradient on its feasible side. The
distances themselves are constrained instead, which says the same: every segment of the arm stays
outside every sphere at every point.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.distance.allowed_contact import all_apart
from ff_planner_ros.planning.distance.certificate import (
    LINES_GAP,
    certificate_gap,
    certified_clearance,
)
from ff_planner_ros.planning.distance.clearance import (
    arm_points,
    clearances,
    may_be_nearest,
    penalty,
    segments,
)
from ff_planner_ros.planning.distance.contact import deepest_contact
from ff_planner_ros.planning.distance.search_certificate import search_distance
from ff_planner_ros.planning.distance.start_room import (
    CLEARANCE_AT_END,
    LEAST_CLEARANCE,
    lines_from_spheres,
    room_of_lines,
)
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.paths.start_approach import NEAR, refuse_approached
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.body_rows import obstacles_in_core
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
from ff_planner_ros.planning.requirements.requirement import Assessment, Samples, elsewhere
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot

# A certificate of a motion at more times begins with every second one: it subdivides intervals
# where that matters.
_ENOUGH = 98


class Clearance(KeptClear):
    """The arm's centre lines stay outside every sphere; collision geometry has `BodyClearance`."""

    name = "clearance"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start inside a sphere, too near to one, or moving into one whatever follows."""
        if problem.robot.geometry is Geometry.SHAPES:
            return
        distance = lines_from_spheres(problem)
        if distance.min(initial=np.inf) >= NEAR:
            return
        starts = segments(arm_points(problem.robot, q_start[None]))
        distance = distance[starts]
        if distance.min() < LEAST_CLEARANCE:
            segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
            link = link_name(problem.robot, int(starts[segment]))
            nearest = float(distance[segment, sphere])
            refuse_nearness(problem.spheres[sphere].id, link, nearest, "arm", "")

        def of_lines(q: Array, times: Array) -> Array:
            found = clearances(arm_points(problem.robot, q), times, starts, problem.spheres)
            return found.distance.reshape(len(q), -1)

        def names(pair: int) -> tuple[str, str]:
            line, sphere = divmod(pair, len(problem.spheres))
            return link_name(problem.robot, int(starts[line])), problem.spheres[sphere].id

        refuse_approached(problem, of_lines, names)

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are centre lines and spheres."""
        return problem.robot.geometry is not Geometry.SHAPES and bool(problem.spheres)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        lines = [body.joint - 2 for body in with_bodies(problem.robot).bodies]
        room = room_of_lines(problem)[lines]
        asked = problem, problem.spheres, points, margin, room, all_apart(room.size)
        return (obstacles_in_core(*asked),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified clearance, or a bound below it that is not negative [m]."""
        if not self.concerns(problem):
            return np.inf
        robot, spheres, last = with_bodies(problem.robot), problem.spheres, len(motion.time) - 1
        chosen = np.arange(len(robot.bodies) * len(spheres))
        asked = robot, motion, spheres, chosen, last, SLACK_PART
        return search_distance(*asked, certificate_gap(problem))

    def assess(self, samples: Samples) -> Assessment:
        """Return R_obst and, of robots with centre lines, the certified clearance [m].

        Failures are the deepest collision, and an obstacle that the last point is too near to.
        """
        found = self._metrics(samples)
        nearest = found.get("min_clearance", np.inf)
        failures = *self._collision(samples, nearest), *_too_near_at_end(samples)
        return Assessment(found, failures)

    def _metrics(self, samples: Samples) -> Mapping[str, Any]:
        problem, settings, times = samples.problem, samples.settings, samples.trajectory.time
        at_points = clearances(samples.arm, times, segments(samples.arm), problem.spheres)
        found: dict[str, Any] = {
            "penalty": penalty(at_points.distance, settings.penalty_gain, settings.penalty_exponent)
        }
        if problem.robot.geometry is Geometry.SHAPES:
            return found
        motion, nearest, certain, pair = samples.followed, np.inf, np.inf, ""
        if problem.spheres:
            arm = arm_points(problem.robot, motion.q)
            sphere, certain = _nearest(problem, motion, arm), _certified(problem, motion, arm)
            nearest, pair, time = sphere.distance, f"{sphere.line}/{sphere.obstacle}", sphere.time
        other = least_from_obstacles(problem, motion)
        if other.found < nearest:
            pair, time = "/".join(body_and_obstacle(problem, other)), other.time
        if not pair:
            return found | {"min_clearance": np.inf}
        return found | {
            "min_clearance": min(certain, other.certified),
            "min_clearance_pair": pair,
            "min_clearance_time": time,
        }

    def _collision(self, samples: Samples, clearance: float) -> Iterator[Failure]:
        problem = samples.problem
        if problem.robot.geometry is Geometry.SHAPES or clearance >= 0.0:
            return
        arm = arm_points(problem.robot, samples.followed.q)
        if problem.obstacle_bodies and not (
            problem.spheres and _certified(problem, samples.followed, arm) < 0.0
        ):
            return
        nearest = _nearest(problem, samples.followed, arm)
        least = Least(clearance, nearest.distance, -1, nearest.time)
        link = link_name(problem.robot, nearest.segment)
        yield collision(samples, least, link, f"obstacle {nearest.obstacle}", detours(problem))


def _too_near_at_end(samples: Samples) -> Iterator[Failure]:
    """Yield the obstacle that the last point, where another plan may start, is too near to."""
    problem, q, end = samples.problem, samples.q[-1], samples.trajectory.time[-1:]
    near: list[tuple[float, str, str]] = []
    contact = deepest_contact(problem, q, float(end[0]), CLEARANCE_AT_END)
    if contact is not None and contact.obstacle:
        near.append((contact.distance, contact.first, contact.second))
    if problem.spheres and problem.robot.geometry is not Geometry.SHAPES:
        starts = segments(samples.arm)
        distance = clearances(samples.arm[-1:], end, starts, problem.spheres).distance[0]
        line, sphere = np.unravel_index(distance.argmin(), distance.shape)
        link = link_name(problem.robot, int(starts[line]))
        near.append((float(distance[line, sphere]), link, problem.spheres[sphere].id))
    distance, body, obstacle = min(near, default=(np.inf, "", ""))
    if 0.0 < distance < CLEARANCE_AT_END:  # a penetration is reported elsewhere
        yield Failure(
            Status.COLLISION,
            f"at its last point {body} is {distance * 1e3:.4f} mm from obstacle {obstacle}, where "
            f"{CLEARANCE_AT_END * 1e3:g} mm are needed so that another plan may start there",
            (elsewhere(problem), "a larger planner.clearance_margin"),
        )


class _Nearest(NamedTuple):
    """Where a line comes nearest to an obstacle at the times of a motion."""

    distance: float  # negative inside [m]
    segment: int  # joint that the line starts at
    line: str  # by the joints at its ends
    obstacle: str
    time: float  # [s]


def _nearest(problem: PlanningProblem, motion: FollowedMotion, arm: Array) -> _Nearest:
    robot, starts = problem.robot, segments(arm)
    spheres = may_be_nearest(arm, motion.time, starts, problem.spheres)
    distance = clearances(arm, motion.time, starts, spheres).distance
    time, segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
    start, ends = int(starts[segment]), (*robot.joint_names, robot.tip_link)
    return _Nearest(
        distance=float(distance[time, segment, sphere]),
        segment=start,
        line=f"{ends[start]}-{ends[start + 1]}",
        obstacle=spheres[sphere].id,
        time=float(motion.time[time]),
    )


def _certified(problem: PlanningProblem, motion: FollowedMotion, arm: Array) -> float:
    """Return the certified clearance [m]."""
    at = _looked_at(motion)
    begin = motion.q[at], motion.v[at], motion.time[at]
    gap = certificate_gap(problem, LINES_GAP)
    return certified_clearance(problem.robot, *begin, problem.spheres, arm[at], gap)


def _looked_at(motion: FollowedMotion) -> slice:
    """Return the times of a motion that a certificate begins with."""
    return slice(None, None, 2 if len(motion.time) > _ENOUGH and len(motion.time) % 2 else 1)


def link_name(robot: Robot, start: int) -> str:
    """Return words for the arm's segment that starts at a joint."""
    ends = (*robot.joint_names, robot.tip_link)
    return f"the link from {ends[start]} to {ends[start + 1]}"
