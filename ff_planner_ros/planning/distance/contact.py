"""Contacts in one configuration: the deepest one, and a joint's motion out of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.allowed_contact import (
    may_touch,
    split_obstacles,
    split_pairs,
)
from ff_planner_ros.planning.distance.bodies import Placed, placed_bodies
from ff_planner_ros.planning.distance.body_distances import (
    obstacle_bounds,
    obstacle_distances,
    obstacle_gradients,
    pair_bounds,
    pair_distances,
    pair_gradients,
)
from ff_planner_ros.planning.distance.solids_apart import distance_between
from ff_planner_ros.planning.distance.surroundings import (
    obstacle_place,
    surroundings,
)
from ff_planner_ros.planning.problem.problem import Orientation, PlanningProblem
from ff_planner_ros.robot.collision.lines import in_words, with_bodies

# Motions of one joint that are tried as a way out of a contact [rad, m].
_TURNS = np.deg2rad([1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0])


class Contact(NamedTuple):
    """Two bodies, or body and obstacle, that touch or are nearer than a clearance."""

    distance: float  # negative: penetration depth [m]
    first: str  # name of a body, or words for a centre line
    second: str  # name of another, or id of an obstacle
    obstacle: bool  # whether the second one is an obstacle
    by_joints: Array  # derivatives of the distance by the joint angles; shape (joints,)


def deepest_contact(
    problem: PlanningProblem, q: Array, time: float = 0.0, within: float = 0.0
) -> Contact | None:
    """Return the deepest contact in a configuration at a time [s] that is not allowed then.

    Args:
        within: Clearance from obstacles [m]; a smaller distance is a contact, too.
    """
    robot, found = with_bodies(problem.robot), list[Contact]()
    placed = placed_bodies(robot, q[None, 7:])
    if robot.pairs:
        found += _of_pairs(problem, placed, q, time)
    if problem.obstacles:
        found += _with_obstacles(problem, placed, q, time, within)
    return _deepest(found, within)


def self_contact(problem: PlanningProblem, positions: Array) -> Contact | None:
    """Return the deepest contact of two bodies in a goal posture; positions: shape (joints,)."""
    if not problem.robot.pairs:
        return None
    q = np.concatenate([pin.neutral(problem.robot.model)[:7], positions])
    placed = placed_bodies(problem.robot, positions[None])
    return _deepest(_of_pairs(problem, placed, q, problem.duration), 0.0)


def _of_pairs(problem: PlanningProblem, placed: Placed, q: Array, time: float) -> Iterator[Contact]:
    """Yield contacts of two bodies, and what may be one."""
    robot, bodies = problem.robot, problem.robot.bodies
    near = pair_bounds(robot, placed) <= 0.0
    near[0, may_touch(problem, split_pairs(problem), q, time)] = False
    rows = np.nonzero(near)
    measured = pair_distances(robot, placed, rows)
    if measured.distance.min(initial=np.inf) > 0.0:
        return
    gradients = pair_gradients(robot, placed, measured, rows)
    for number, distance, by_joints in zip(rows[1], measured.distance, gradients, strict=True):
        first, second = (bodies[body].name for body in robot.pairs[number])
        yield Contact(float(distance), first, second, False, by_joints)


def _deepest(found: Iterable[Contact], within: float) -> Contact | None:
    touching = [
        contact
        for contact in found
        if contact.distance <= 0.0 or (contact.obstacle and contact.distance < within)
    ]
    return min(touching, key=lambda contact: contact.distance, default=None)


def _with_obstacles(
    problem: PlanningProblem, placed: Placed, q: Array, time: float, within: float
) -> Iterator[Contact]:
    """Yield contacts with obstacles, and what may be one."""
    robot, around = with_bodies(problem.robot), surroundings(problem.obstacles)
    at_time = np.array([time])
    near = obstacle_bounds(robot, placed, q[None], at_time, around) <= within
    near.reshape(-1)[may_touch(problem, split_obstacles(problem), q, time)] = False
    at = np.nonzero(near)
    there = around.seen_from_base(q[None], at_time, at[0], at[2])
    measured = obstacle_distances(robot, placed, there, around, at)
    if measured.distance.min(initial=np.inf) > within:
        return
    gradients = obstacle_gradients(robot, placed, measured, at)[:, 6:]
    for body, number, distance, by_joints in zip(
        *at[1:], measured.distance, gradients, strict=True
    ):
        names = in_words(problem.robot, body), problem.obstacles[number].id
        yield Contact(float(distance), *names, True, by_joints)


def way_out(problem: PlanningProblem, q: Array, contact: Contact, within: float = 0.0) -> str:
    """Return words for one joint's motion that ends all contacts; empty: none was found.

    Args:
        q: Configuration with this deepest contact. Shape (7 + joints,).
        within: As for `deepest_contact`.
    """
    robot = problem.robot
    for turn in _TURNS:
        # First the way that the distance grows; deep inside, the other may be the shorter one.
        ways = [math.copysign(turn, slope) for slope in contact.by_joints]
        order = np.argsort(-np.abs(contact.by_joints), kind="stable").tolist()
        for joint, way in [(j, sign * ways[j]) for sign in (1.0, -1.0) for j in order]:
            aside = q.copy()
            aside[7 + joint] += way
            lower, upper = robot.lower_position_limits[joint], robot.upper_position_limits[joint]
            if not (contact.by_joints[joint] and lower <= aside[7 + joint] <= upper):
                continue
            if deepest_contact(problem, aside, within=within) is None:
                by = float(aside[7 + joint] - q[7 + joint])
                moved = f"turned by {math.degrees(by):+.0f} deg"
                if robot.slides(joint):
                    moved = f"moved by {by:+.3f} m"
                return f"; {robot.joint_names[joint]} {moved} is out of it"
    return ""


def tool_contact(problem: PlanningProblem) -> Contact | None:
    """Return the deepest contact at the goal between an obstacle and what the last joint carries.

    None, too, if the target leaves orientation free: no contact is certain then.
    """
    robot, target = problem.robot, problem.target
    if target.orientation is not Orientation.FIXED:
        return None
    goal = pin.SE3(pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(), target.position)
    last_joint = goal * robot.model.frames[robot.tip_frame_id].placement.inverse()
    allowed, found = split_obstacles(problem).may_touch, list[Contact]()
    around, end = surroundings(problem.obstacles), problem.duration
    for number, body in enumerate(with_bodies(robot).bodies):
        if body.joint != robot.tree.tip + 1:
            continue
        at = last_joint * body.placement_in_joint
        for index in around.near(last_joint.act(body.center_in_joint), body.radius, end):
            one = problem.obstacles[index]
            there = obstacle_place(one, end)
            distance = distance_between(body.solid, at, one.solid.geometry, there)
            if distance <= 0.0 and number * len(problem.obstacles) + index not in allowed:
                name = in_words(robot, number)
                found.append(Contact(distance, name, one.id, True, np.zeros(robot.joints)))
    return min(found, key=lambda contact: contact.distance, default=None)
