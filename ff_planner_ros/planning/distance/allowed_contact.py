"""Which bodies may touch what, and when: a tool closes on what it grasps, and lets go of it.

A pair that a task allows to touch may do so in the last part of the way: from when on the end
effector stays within the problem's contact distance from its goal, and in the tail. The goal is
where the grasp is at each moment. Where such a pair touches at the start, it may also do so in the
first part: until the end effector is further than that distance from where it began, seen from the
obstacle that is touched, or from the base where the pair is the robot's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import centers_in_base
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.distance.obstacle_distances import obstacle_poses
from ff_planner_ros.planning.distance.start_room import (
    KEPT,
    LEAST_CLEARANCE,
    room_of_bodies,
    room_of_obstacles,
    room_of_pairs,
)
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration


class Split(NamedTuple):
    """What is measured, by its numbers: what never touches, and what may."""

    apart: Indices
    at_goal: Indices  # there alone
    # At the goal, and at the start, where it touches: with the obstacle, None: another link
    at_start: tuple[tuple[Obstacle | None, Indices], ...]

    @property
    def may_touch(self) -> Indices:
        """All that may at the goal."""
        return np.concatenate([self.at_goal, *(numbers for _, numbers in self.at_start)])


@lru_cache(maxsize=4)
def split_pairs(problem: PlanningProblem) -> Split:
    """Return the pairs of bodies by whether they may touch."""
    bodies, allowed = problem.robot.bodies, problem.allowed_collisions
    names = [(bodies[a].link, bodies[b].link) for a, b in problem.robot.pairs]
    may = [f"{a}/{b}" in allowed or f"{b}/{a}" in allowed for a, b in names]
    return _split(may, room_of_pairs(problem) if any(may) else np.empty(0), (None,))


@lru_cache(maxsize=4)
def split_spheres(problem: PlanningProblem) -> Split:
    """Return likewise bodies and spheres: body times the number of spheres, plus sphere."""
    may = [
        f"{body.link}/{sphere.id}" in problem.allowed_collisions
        for body in problem.robot.bodies
        for sphere in problem.spheres
    ]
    return _split(may, room_of_bodies(problem) if any(may) else np.empty(0), problem.spheres)


@lru_cache(maxsize=4)
def split_obstacles(problem: PlanningProblem) -> Split:
    """Return likewise bodies and obstacles of any shape: body times their number, plus obstacle."""
    may = [
        f"{body.link}/{one.id}" in problem.allowed_collisions
        for body in with_bodies(problem.robot).bodies
        for one in problem.obstacle_bodies
    ]
    room = room_of_obstacles(problem) if any(may) else np.empty(0)
    return _split(may, room, problem.obstacle_bodies)


def before_contact(problem: PlanningProblem, times: Array, q: Array, within: float = 1.0) -> int:
    """Return the last configuration of a motion at which the allowed pairs, too, must be apart.

    A goal of the joints has no place, and nothing may touch there.

    Args:
        times: From the plan's first point on, ascending. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        within: Part of the contact distance that counts.

    Returns:
        Its number; -1: none is.
    """
    if problem.posture is not None:
        return len(times) - 1
    points = arm_points(problem.robot, q)[:, -1]
    to_goal = np.linalg.norm(GraspSeen(problem, times).from_grasp(points), axis=1)
    outside = np.flatnonzero(to_goal > within * problem.contact_distance)
    return int(outside[-1]) if outside.size else -1


def after_contact(
    problem: PlanningProblem,
    obstacle: Obstacle | None,
    times: Array,
    q: Array,
    within: float = 1.0,
) -> int:
    """Return the first configuration at which what touches an obstacle at the start must be apart.

    Args:
        obstacle: None: another link of the robot.
        times: From the plan's first point on, ascending. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        within: Part of the contact distance that counts.

    Returns:
        Its number; as many as there are: none is.
    """
    first = configuration(problem.robot, problem.start)[0]
    times, q = np.append(0.0, times), np.vstack([first, q])
    points = arm_points(problem.robot, q)[:, -1]
    if obstacle is None:
        seen = centers_in_base(q, points[:, None])[:, 0]
    else:
        rotations, origins = obstacle_poses(obstacle, times)
        seen = np.einsum("tji,tj->ti", rotations, points - origins)
    ways = np.linalg.norm(seen[1:] - seen[0], axis=1)
    outside = np.flatnonzero(ways > within * problem.contact_distance)
    return int(outside[0]) if outside.size else len(ways)


def stretches(
    problem: PlanningProblem, motion: FollowedMotion, split: Split
) -> Iterator[tuple[FollowedMotion, Indices, int]]:
    """Yield what must not touch, each with a motion and its last point at which that holds."""
    yield motion, split.apart, len(motion.time) - 1
    if not len(split.may_touch):
        return
    until = before_contact(problem, motion.time, motion.q)
    yield motion, split.at_goal, until
    for obstacle, numbers in split.at_start:
        first = after_contact(problem, obstacle, motion.time, motion.q)
        time, q, v = motion.time[first:], motion.q[first:], motion.v[first:]
        if first <= until:
            yield replace(motion, time=time, q=q, v=v, maps=None), numbers, until - first


def may_touch(problem: PlanningProblem, split: Split, q: Array, time: float) -> Indices:
    """Return what may touch in a configuration that a plan may have at a time [s]."""
    if not len(split.may_touch):
        return split.may_touch
    at = np.array([time]), q[None]
    if before_contact(problem, *at) < 0:
        return split.may_touch
    held = [numbers for one, numbers in split.at_start if after_contact(problem, one, *at)]
    return np.concatenate([np.empty(0, np.intp), *held])


def _split(may: list[bool], room: Array, obstacles: tuple[Obstacle | None, ...]) -> Split:
    """Return what may touch, apart from what does not.

    Args:
        room: Of all, at the start; empty where none may touch [m].
        obstacles: Of all, in turn.
    """
    flags = np.array(may, bool)
    touches = flags & (room.ravel() < KEPT * LEAST_CLEARANCE) if room.size else np.zeros_like(flags)
    number = np.arange(len(flags)) % max(len(obstacles), 1)
    groups = tuple(
        (obstacles[k], np.flatnonzero(touches & (number == k))) for k in np.unique(number[touches])
    )
    return Split(np.flatnonzero(~flags), np.flatnonzero(flags & ~touches), groups)
