"""The end effector comes to the grasp along its corridor, between the points too."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.distance.clearance import arm_points, arm_points_with_derivatives
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    OF_INTEREST,
    Requirement,
    Rows,
    Samples,
)
from ff_planner_ros.robot.model import Robot

# The search keeps this much more at the distance [m], and towards the grasp, where the corridor is
# narrow, in proportion less.
_MARGIN = 1e-3
# Between the points the margin is known to this [m]: a tenth of the corridor's radius at the grasp.
_GAP = 5e-4


class ApproachCorridor(Requirement):
    """The end effector keeps to the corridor near the grasp, where there is one."""

    name = "approach"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start near the grasp and beside the corridor."""
        if problem.approach is None:
            return
        places = GraspSeen(problem, np.zeros(1)).sees(
            arm_points(problem.robot, q_start[None])[:, -1]
        )
        if problem.approach.margins(places).values[0] < -LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                "approach.distance",
                f"{problem.approach.distance:g} m",
                f"at the start the end effector is {_words(problem.approach, places[0])}; it must "
                "begin further from the grasp than the distance, or in the corridor",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how much further inside the search stays where the corridor begins [m]."""
        return _MARGIN

    def rows(
        self, problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
    ) -> Rows | None:
        """Return the margins of interest, less what is kept more, at points and half-way [m]."""
        approach = problem.approach
        if approach is None:
            return None
        times = np.linspace(0.0, problem.duration, len(motion.q))
        grasp = GraspSeen(problem, np.concatenate([times[1:], (times[:-1] + times[1:]) / 2]))
        points, derivatives = arm_points_with_derivatives(
            problem.robot,
            np.concatenate([motion.q[1:], motion.q_half_way]),
            np.concatenate([sensitivity.q[1:], sensitivity.q_half_way]),
        )
        places = grasp.sees(points[:, -1])
        margins = approach.margins(places)
        away = np.linalg.norm(places, axis=1)
        kept = margin * np.minimum(away / approach.distance, 1.0)
        by_place = margins.gradients - np.where(
            (away < approach.distance)[:, None],
            margin / approach.distance * places / np.maximum(away, np.finfo(float).tiny)[:, None],
            0.0,
        )
        values = margins.values - kept
        (near,) = np.nonzero(values < OF_INTEREST)
        by_point = grasp.in_inertial(by_place)[near]
        jacobian = np.einsum("ri,rix->rx", by_point, derivatives[near, -1])
        if sensitivity.goal_motion is not None:
            seen = grasp.sees_by_duration(points[:, -1], sensitivity.goal_motion.place)
            jacobian[:, -1] += np.sum(by_place * seen, axis=1)[near]
        names = 2 * near + margins.by_cone[near].astype(np.intp)
        return Rows(values[near], jacobian, names)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified margin [m]."""
        if problem.approach is None:
            return np.inf
        return _least(problem, problem.approach, motion.time, motion.q, motion.v).certified

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield when the end effector is furthest beside the corridor."""
        problem = samples.problem
        if problem.approach is None:
            return
        motion = samples.followed
        to_goal = slice(motion.pieces * samples.goal + 1)
        way = motion.time[to_goal], motion.q[to_goal], motion.v[to_goal]
        least = _least(problem, problem.approach, *way)
        if least.certified >= -LIMIT_TOLERANCE:
            return
        when, words = samples.at(least.time), _words(problem.approach, least.place)
        if least.margin >= 0.0:
            yield Failure(
                Status.LIMIT_VIOLATED,
                f"the end effector may leave the corridor of the approach near {when}, {words}: "
                f"all that is certain is a margin of {least.certified * 1e3:.2f} mm",
                ("more points", "a larger approach.half_angle"),
            )
            return
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"at {when} the end effector is {words}: it is {-least.margin * 1e3:.2f} mm beside the "
            "corridor of the approach",
            (
                "a larger approach.half_angle",
                "a shorter approach.distance",
                "another approach.direction or grasp",
                "a longer duration",
                "more points",
                "more planner.starts",
            ),
        )


class _Least(NamedTuple):
    """Where the margin is least along a motion."""

    certified: float  # a bound of it at all times [m]
    margin: float  # the least that was found [m]
    time: float  # of that [s]
    place: Array  # of the end effector then, in the grasp's frame; shape (3,) [m]


def _least(
    problem: PlanningProblem, approach: Approach, times: Array, q: Array, v: Array
) -> _Least:
    """Return the least margin along a motion, by Pinocchio alone.

    Seen from the grasp the end effector moves, from one configuration to the next, on the cubic
    through both places and velocities. In a piece of it the margin changes by no more than its
    speed allows; pieces whose bound is too low to tell are halved.

    Args:
        times: From the plan's first point to the goal. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        v: Tangent velocities. Shape (times, 6 + joints).
    """
    grasp = GraspSeen(problem, times)
    points, velocities = _end_effector(problem.robot, q, v)
    places, rates = grasp.sees(points), grasp.sees_moving(points, velocities)
    steps, way = np.diff(times)[:, None], np.diff(places, axis=0)
    first, last = steps * rates[:-1], steps * rates[1:]
    cubics = np.stack([first, 3 * way - 2 * first - last, first + last - 2 * way], axis=1)
    # The rate is a Bezier curve of second order: never faster than the fastest of its points.
    control = np.stack([first, 3 * way - first - last, last])
    fastest = np.linalg.norm(control, axis=2).max(axis=0)
    values = approach.margins(places).values
    number = int(values.argmin())
    lowest, when, where = float(values[number]), float(times[number]), places[number]
    certified = lowest
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    at_begin, at_end = values[:-1], values[1:]
    while True:
        bound = (at_begin + at_end - fastest[index] * (end - begin)) / 2
        open_ = bound < lowest - _GAP
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return _Least(certified, lowest, when, where)
        index, begin, end = index[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        powers = middle[:, None] ** np.array([1, 2, 3])
        between = places[index] + np.einsum("ip,ipj->ij", powers, cubics[index])
        at_middle = approach.margins(between).values
        number = int(at_middle.argmin())
        if at_middle[number] < lowest:
            lowest, where = float(at_middle[number]), between[number]
            when = float(times[index[number]] + middle[number] * steps[index[number], 0])
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


def _end_effector(robot: Robot, q: Array, v: Array) -> tuple[Array, Array]:
    """Return where the end effector is and how fast it moves, inertial axes. Each (times, 3)."""
    model, frame = robot.model, robot.tip_frame_id
    data = model.createData()
    points, velocities = np.empty((len(q), 3)), np.empty((len(q), 3))
    for k, at in enumerate(zip(q, v, strict=True)):
        pin.forwardKinematics(model, data, *at)
        points[k] = pin.updateFramePlacement(model, data, frame).translation
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        velocities[k] = twist.linear
    return points, velocities


def _words(approach: Approach, place: Array) -> str:
    """Return words for where the end effector is, seen from the grasp."""
    away, (angle,) = float(np.linalg.norm(place)), approach.angles(place[None])
    return (
        f"{away:.4f} m from the grasp and {math.degrees(angle):.2f} deg off approach.direction, "
        f"allowed are {math.degrees(approach.half_angle):.4g} deg within {approach.distance:g} m"
    )
