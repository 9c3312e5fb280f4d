"""Allowed contacts: which pairs may touch, and when; a tool closes on what it grasps or releases.

An allowed pair may touch from the time at which the end effector enters the contact distance around
its goal for the last time, and in the post-goal segment. The goal is the grasp as it moves. A pair
that touches at the start may also do so until the end effector has first moved further than the
contact distance from its start, seen from the obstacle, or from the base for two links.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import obstacle_distances
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.distance.start_room import (
    KEPT,
    LEAST_CLEARANCE,
    room_of_obstacles,
    room_of_pairs,
)
from ff_planner_ros.planning.distance.surroundings import obstacle_poses, surroundings
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

# A certificate may be below the truth by this fraction of the distance at the start.
_GAP = 0.25
_FIRST = np.zeros(1, np.intp)


class Split(NamedTuple):
    """Numbers of pairs, of bodies or of body and obstacle, split by when they may touch."""

    apart: Indices  # never
    at_goal: Indices  # near the goal only
    # Near the goal and, as they touch there, near the start; by obstacle, None: another link
    at_start: tuple[tuple[Obstacle | None, Indices], ...]

    @property
    def may_touch(self) -> Indices:
        """Numbers of all pairs that may touch near the goal."""
        return np.concatenate([self.at_goal, *(numbers for _, numbers in self.at_start)])


@lru_cache(maxsize=4)
def split_pairs(problem: PlanningProblem) -> Split:
    """Split pairs of bodies; number: index in `robot.pairs`."""
    bodies, allowed = problem.robot.bodies, problem.allowed_collisions
    if not allowed:
        return _all_apart(len(problem.robot.pairs))
    names = [(bodies[a].link, bodies[b].link) for a, b in problem.robot.pairs]
    may = [f"{a}/{b}" in allowed or f"{b}/{a}" in allowed for a, b in names]
    return _split(may, room_of_pairs(problem) if any(may) else np.empty(0), (None,))


@lru_cache(maxsize=4)
def split_obstacles(problem: PlanningProblem) -> Split:
    """Split bodies with obstacles; number: body times obstacles, plus obstacle."""
    bodies, obstacles = with_bodies(problem.robot).bodies, problem.obstacles
    if not problem.allowed_collisions:
        return _all_apart(len(bodies) * len(obstacles))
    may = [
        f"{body.link}/{one.id}" in problem.allowed_collisions
        for body in bodies
        for one in obstacles
    ]
    return _split(may, room_of_obstacles(problem) if any(may) else np.empty(0), obstacles)


def certificate_gap(problem: PlanningProblem, most: float) -> float:
    """Return how far certificates may be below the truth for the start to pass [m].

    Args:
        most: The answer if no obstacle is near the start, or one is touched [m].
    """
    near = start_clearance(problem)
    return min(most, _GAP * near) if near > 0.0 else most  # a start in contact is refused


def start_clearance(problem: PlanningProblem) -> float:
    """Return the distance from the nearest obstacle at the start, without allowed contacts [m]."""
    room = room_of_obstacles(problem).ravel()[split_obstacles(problem).apart]
    return float(room.min(initial=np.inf)) / KEPT


def before_contact(problem: PlanningProblem, times: Array, tips: Array) -> int:
    """Return the index of the last configuration at which allowed pairs, too, must be apart.

    That is the last one of a motion to a posture: its goal has no place to touch at.

    Args:
        times: From the plan's first point on, ascending. Shape (times,) [s].
        tips: Where the end effector is, inertial frame. Shape (times, 3) [m].

    Returns:
        Index into `times`; -1 if there is none.
    """
    if problem.posture is not None:
        return len(times) - 1
    to_goal = np.linalg.norm(GraspSeen(problem, times).from_grasp(tips), axis=1)
    outside = np.flatnonzero(to_goal > problem.contact_distance)
    return int(outside[-1]) if outside.size else -1


def after_contact(
    problem: PlanningProblem, obstacle: Obstacle | None, times: Array, q: Array
) -> int:
    """Return the index of the first configuration at which contacts of the start must be apart.

    Args:
        obstacle: The one that they touch; None: another link of the robot.
        times: From the plan's first point on, ascending. Shape (times,) [s].
        q: Shape (times, 7 + joints).

    Returns:
        Index into `times`; len(times) if there is none.
    """
    first = configuration(problem.robot, problem.start)[0]
    times, q = np.append(0.0, times), np.vstack([first, q])
    ways = _ways_from_start(problem.robot, obstacle, times, q)[1:]
    outside = np.flatnonzero(ways > problem.contact_distance)
    return int(outside[0]) if outside.size else len(ways)


def contacts_in_core(
    problem: PlanningProblem, split: Split, times: Array, within: float
) -> compiled.AllowedContacts | None:
    """Return what `before_contact` and `after_contact` need to know of a path's configurations.

    Args:
        times: From the plan's first point on, ascending. Shape (times,) [s].
        within: Fraction of the contact distance to use instead of all of it.

    Returns:
        None: no pair may touch.
    """
    if not len(split.may_touch):
        return None
    has_place = problem.posture is None
    return compiled.AllowedContacts(
        split.at_goal,
        GraspSeen(problem, times).positions if has_place else np.empty((0, 3)),
        within * problem.contact_distance,
        [
            compiled.ContactsAtStart(numbers, _stayed(problem, obstacle, times), obstacle is None)
            for obstacle, numbers in split.at_start
        ],
    )


def stretches(
    problem: PlanningProblem, motion: FollowedMotion, split: Split
) -> Iterator[tuple[FollowedMotion, Indices, int]]:
    """Yield parts of a motion, pairs that must be apart in them, and the last index of that."""
    yield motion, split.apart, len(motion.time) - 1
    if not len(split.may_touch):
        return
    until = before_contact(problem, motion.time, arm_points(problem.robot, motion.q)[:, -1])
    yield motion, split.at_goal, until
    for obstacle, numbers in split.at_start:
        first = after_contact(problem, obstacle, motion.time, motion.q)
        if first <= until:
            # A motion has two times: if one alone is left, it counts twice.
            last = len(motion.time) - 1
            rest = np.minimum(np.arange(first, max(last, first + 1) + 1), last)
            after = replace(
                motion,
                time=motion.time[rest],
                q=motion.q[rest],
                v=motion.v[rest],
                joint_accelerations=motion.joint_accelerations[rest],
                maps=None,
            )
            yield after, numbers, until - first


def may_touch(problem: PlanningProblem, split: Split, q: Array, time: float) -> Indices:
    """Return the numbers of pairs that may touch in a configuration at a time [s] of a plan."""
    if not len(split.may_touch):
        return split.may_touch
    times, q = np.array([time]), q[None]
    if before_contact(problem, times, arm_points(problem.robot, q)[:, -1]) < 0:
        return split.may_touch
    held = [numbers for one, numbers in split.at_start if after_contact(problem, one, times, q)]
    return np.concatenate([np.empty(0, np.intp), *held])


class KeptApart(NamedTuple):
    """Indices of the times at which each part must be apart from each obstacle."""

    since: Indices  # shape (bodies, obstacles)
    until: Indices  # not at this one any more; likewise

    def at(self, numbers: Indices) -> NDArray[np.bool_]:
        """Tell what must be apart at some times. Shape (times, bodies, obstacles)."""
        each = numbers[:, None, None]
        found: NDArray[np.bool_] = (self.since <= each) & (each < self.until)
        return found


def kept_apart(
    robot: Robot, obstacles: Sequence[Obstacle], scene: Scene, q: Array, times: Array
) -> KeptApart:
    """Return when each part must be apart from each obstacle along a planned motion.

    Args:
        obstacles: Those of the scene, in the order of the columns.
        scene: In the frame of q.
        q: The first one is the plan's. Shape (times, 7 + joints).
        times: Shape (times,) [s].
    """
    robot = with_bodies(robot)
    names = [body.link for body in robot.bodies]
    since, until = np.zeros((2, len(names), len(obstacles)), np.intp)
    until[:] = len(times)
    if not scene.allowed_collisions:
        return KeptApart(since, until)
    at_goal_from = _at_goal_from(robot, scene, q, times)
    for row, column in np.ndindex(since.shape):
        one = obstacles[column]
        if f"{names[row]}/{one.id}" not in scene.allowed_collisions:
            continue
        until[row, column] = at_goal_from
        if _distance(robot, row, one, q[:1], times[:1]) < LEAST_CLEARANCE:
            ways = _ways_from_start(robot, one, times, q)
            outside = np.flatnonzero(ways > scene.contact_distance)
            since[row, column] = outside[0] if outside.size else len(times)
    return KeptApart(since, until)


def _at_goal_from(robot: Robot, scene: Scene, q: Array, times: Array) -> int:
    """Return the index of the time from which the end effector stays at the scene's target."""
    goal = scene.targets(times)
    if goal is None:
        return len(times)
    away = np.linalg.norm(arm_points(robot, q)[:, -1] - goal, axis=1) > scene.contact_distance
    outside = np.flatnonzero(away)
    return int(outside[-1]) + 1 if outside.size else 0


def _distance(robot: Robot, body: int, obstacle: Obstacle, q: Array, times: Array) -> float:
    """Return the distance of a body, by its number, from an obstacle at one time [m]."""
    around, rows = surroundings((obstacle,)), (_FIRST, np.array([body]), _FIRST)
    there = around.seen_from_base(q, times, _FIRST, _FIRST)
    placed = placed_bodies(robot, q[:, 7:])
    return float(obstacle_distances(robot, placed, there, around, rows).distance[0])


def _ways_from_start(robot: Robot, obstacle: Obstacle | None, times: Array, q: Array) -> Array:
    """Return how far the end effector is from its first place. Shape (times,) [m].

    Args:
        obstacle: That it is seen from; None: the base.
    """
    points = arm_points(robot, q)[:, -1]
    if obstacle is None:
        seen = centers_in_base(q, points[:, None])[:, 0]
    else:
        rotations, origins = obstacle_poses(obstacle, times)
        seen = np.einsum("tji,tj->ti", rotations, points - origins)
    ways: Array = np.linalg.norm(seen - seen[0], axis=1)
    return ways


def _stayed(problem: PlanningProblem, obstacle: Obstacle | None, times: Array) -> Array:
    """Return where the end effector would be as if it had not moved yet. Shape (times, 3) [m].

    Args:
        obstacle: As this sees it, in the inertial frame. None: as the base does, in its frame.
    """
    q = configuration(problem.robot, problem.start)[0][None]
    place = arm_points(problem.robot, q)[:, -1]
    if obstacle is None:
        return np.tile(centers_in_base(q, place[:, None])[0], (len(times), 1))
    rotations, origins = obstacle_poses(obstacle, np.append(0.0, times))
    seen = rotations[0].T @ (place[0] - origins[0])
    return np.asarray(origins[1:] + rotations[1:] @ seen, np.float64)


def _all_apart(count: int) -> Split:
    return Split(np.arange(count), np.empty(0, np.intp), ())


def _split(may: list[bool], room: Array, obstacles: tuple[Obstacle | None, ...]) -> Split:
    """Split pairs by whether they may touch, and those that may by whether they do at the start.

    Args:
        room: Of `start_room`, for every pair; empty if none may touch [m].
        obstacles: Of the pairs, in turn.
    """
    flags = np.array(may, bool)
    if not flags.any():
        return _all_apart(len(flags))
    touches = flags & (room.ravel() < KEPT * LEAST_CLEARANCE)
    number = np.arange(len(flags)) % max(len(obstacles), 1)
    groups = tuple(
        (obstacles[k], np.flatnonzero(touches & (number == k))) for k in np.unique(number[touches])
    )
    return Split(np.flatnonzero(~flags), np.flatnonzero(flags & ~touches), groups)
