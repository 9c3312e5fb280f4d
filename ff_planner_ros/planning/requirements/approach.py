"""The end effector approaches the grasp inside the corridor, between the points too."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen, grasp_of_path
from ff_planner_ros.planning.distance.moving_place import least_margin
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.approach import RADIUS_AT_GRASP, Approach
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    OF_INTEREST,
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.model import Robot

# The search keeps this much more at the distance [m], and towards the grasp, where the corridor is
# narrow, in proportion less.
_MARGIN = 1e-3


class ApproachCorridor(Requirement):
    """Within `approach.distance` of the grasp, the end effector stays inside the corridor."""

    name = "approach"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start within the approach distance, but outside the corridor."""
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
        """Return the margin at the approach distance [m]; nearer the grasp it is less."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there is a corridor."""
        return problem.approach is not None

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        approach = problem.approach
        if approach is None:
            return ()
        return (
            compiled.in_corridor(
                grasp_of_path(problem, points).in_core(),
                approach.direction,
                approach.distance,
                approach.half_angle,
                RADIUS_AT_GRASP,
                approach.back_off,
                margin,
                OF_INTEREST,
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified margin [m]."""
        if problem.approach is None:
            return np.inf
        return _least(problem, problem.approach, motion.time, motion.q, motion.v)[0].certified

    def assess(self, samples: Samples) -> Assessment:
        """Return the failure of the place furthest outside the corridor, with its time."""
        problem = samples.problem
        if problem.approach is None:
            return Assessment()
        least, place = _least(problem, problem.approach, *samples.followed_to_goal)
        if least.certified >= -LIMIT_TOLERANCE:
            return Assessment()
        when, words = samples.at(least.time), _words(problem.approach, place)
        if least.found >= 0.0:
            failure = Failure(
                Status.LIMIT_VIOLATED,
                f"the end effector may leave the corridor of the approach near {when}, {words}: "
                f"all that is certain is a margin of {least.certified * 1e3:.2f} mm",
                ("more points", "a larger approach.half_angle"),
            )
            return Assessment(failures=(failure,))
        failure = Failure(
            Status.LIMIT_VIOLATED,
            f"at {when} the end effector is {words}: it is {-least.found * 1e3:.2f} mm beside the "
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
        return Assessment(failures=(failure,))


def _least(
    problem: PlanningProblem, approach: Approach, times: Array, q: Array, v: Array
) -> tuple[Least, Array]:
    """Return the least margin along a motion, by Pinocchio alone.

    Args:
        times: From the plan's first point to the goal. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        v: Tangent velocities. Shape (times, 6 + joints).
    """
    grasp = GraspSeen(problem, times)
    points, velocities = _end_effector(problem.robot, q, v)
    places, seen = grasp.sees(points), grasp.sees_moving(points, velocities)
    return least_margin(times, places, seen, lambda at: approach.margins(at).values)


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
    """Return words for a place of the end effector in the grasp frame."""
    away, (angle,) = float(np.linalg.norm(place)), approach.angles(place[None])
    return (
        f"{away:.4f} m from the grasp and {math.degrees(angle):.2f} deg off approach.direction, "
        f"allowed are {math.degrees(approach.half_angle):.4g} deg within {approach.distance:g} m"
    )
