"""The end effector stays within the tolerances of a path, between the points too.

The search keeps each component of the error, in inertial axes, within a bound of its own: a cube in
the sphere of the tolerance. These rows are nearly linear in the path's variables, and hold the end
effector from all sides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.distance.moving_place import least_margin
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.path.followed import PathToFollow, curve_of
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    Assessment,
    Requirement,
    Samples,
)

# Of a tolerance: the search keeps this less at the points; between them the error is known to this;
# and what rounding may add.
_MARGIN, _GAP, _ROUNDING = 0.05, 0.02, 1e-6
# Least number of points that may say how fast the first is passed, and how often the first interval
# is looked at for that.
_DENSE, _LOOKS = 5, 9
# What a point of a path calls the two.
_FIELDS = {"position": "position", "orientation": "quaternion_xyzw"}


class FollowsPath(Requirement):
    """The end effector follows the path, if there is one; slacks are parts of the tolerances."""

    name = "path"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a path that does not begin where the end effector is, or as it moves."""
        if problem.path is None:
            return
        still = np.zeros((1, problem.robot.model.nv))
        for error in _errors(problem, problem.path, np.zeros(1), q_start[None], still):
            away = float(np.linalg.norm(error.vectors[0]))
            if away > error.tolerance:
                raise InvalidInput(
                    Status.START_OUTSIDE_LIMITS,
                    f"target.path[0].{_FIELDS[error.kind]}",
                    f"{away:.6g} {error.unit} from the end effector at the start",
                    f"the path must begin where the end effector is, within {error.tolerance:g} "
                    f"{error.unit}",
                )
        _refuse_speed(problem, problem.path)

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return the part of the tolerances that is kept free at the points."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there is a path to follow."""
        return problem.path is not None

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        path = problem.path
        if path is None:
            return ()
        times = np.linspace(0.0, problem.duration, points)
        poses = curve_of(problem).at(np.concatenate([times[1:], (times[:-1] + times[1:]) / 2]))
        rows, kept = problem.robot.base.tip_rows, max(1.0 - margin, 0.0)
        linear = sum(row < 3 for row in rows)
        return (
            compiled.follows_path(
                poses.positions,
                np.empty((0, 3)) if poses.rotations is None else poses.rotations.reshape(-1, 3),
                rows,
                kept * path.position_tolerance / math.sqrt(linear),
                kept * path.orientation_tolerance / math.sqrt(len(rows) - linear),
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified margin as a part of the tolerances, the least of both."""
        if problem.path is None:
            return np.inf
        errors = _errors(problem, problem.path, motion.time, motion.q, motion.v)
        return min(_least(motion.time, one).certified / one.tolerance for one in errors)

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest errors along the path, and failures where they are too large."""
        problem, found, failures = samples.problem, dict[str, float](), list[Failure]()
        if problem.path is None:
            return Assessment()
        times, *motion = samples.followed_to_goal
        for error in _errors(problem, problem.path, times, *motion):
            least = _least(times, error)
            found[f"max_path_{error.kind}_error"] = error.tolerance - least.found
            if least.certified < -_ROUNDING * error.tolerance:
                failures.append(_failure(samples, error, least))
        return Assessment(found, failures)


def _refuse_speed(problem: PlanningProblem, path: PathToFollow) -> None:
    """Refuse points that ask for another velocity at the start than the end effector has.

    The curve that begins with the end effector's velocity would swing round them.

    Raises:
        InvalidInput: It leaves the points' own curve by more than a tolerance.
    """
    own, first = path.curve(), path.times[1:2]
    tolerances = path.position_tolerance, path.orientation_tolerance
    # Points say how fast they are passed only where half of them give the same curve.
    half = replace(path, points=path.points[::2]).curve() if len(path.points) >= _DENSE else None
    if half is None or np.any(np.greater(half.at(first).apart(own.at(first)), tolerances)):
        return
    times = np.linspace(0.0, first[0], _LOOKS)
    swings = own.at(times).apart(curve_of(problem).at(times))
    wanted, given = (each.at(times[:1]).twists[0] for each in (own, curve_of(problem)))
    kinds = ("m", slice(0, 3)), ("rad", slice(3, 6))
    for swing, tolerance, (unit, part) in zip(swings, tolerances, kinds, strict=True):
        if swing > tolerance:
            speeds = [np.linalg.norm(each[part]) for each in (wanted, given, wanted - given)]
            passed, begun, apart = (f"{speed:.4g} {unit}/s" for speed in speeds)
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                "target.path[0]",
                f"passed at {passed}, where the end effector begins at {begun}, {apart} apart",
                f"the curve that begins as the end effector swings {swing:.3g} {unit} away from "
                f"that of the points, allowed is {tolerance:g} {unit}: give joints.velocity, with "
                "the chaser's velocities, so that the end effector moves as the path, or points "
                "that begin as slowly as the end effector",
            )


class _Error(NamedTuple):
    """The error of one kind along a motion."""

    vectors: Array  # from the path to the end effector; shape (times, 3)
    rates: Array  # their derivatives by time; shape (times, 3)
    tolerance: float
    kind: str  # position or orientation
    unit: str


def _errors(
    problem: PlanningProblem, path: PathToFollow, times: Array, q: Array, v: Array
) -> Iterator[_Error]:
    """Yield the errors in position and, if the path has one, in orientation, by Pinocchio alone.

    Args:
        times: From the plan's first point on. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        v: Tangent velocities. Shape (times, 6 + joints).
    """
    poses, robot = curve_of(problem).at(times), problem.robot
    errors = np.empty((4, len(times), 3))  # of position and orientation: errors, then their rates
    model, data, frame = robot.model, robot.model.createData(), robot.tip_frame_id
    for k, at in enumerate(zip(q, v, strict=True)):
        pin.forwardKinematics(model, data, *at)
        tip = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        errors[0, k] = tip.translation - poses.positions[k]
        errors[2, k] = twist.linear - poses.twists[k, :3]
        if poses.rotations is not None:
            wanted = poses.rotations[k]
            turned, spin = wanted.T @ tip.rotation, twist.angular - poses.twists[k, 3:]
            errors[1, k] = vector = wanted @ pin.log3(turned)
            errors[3, k] = wanted @ pin.Jlog3(turned) @ tip.rotation.T @ spin
            errors[3, k] += np.cross(poses.twists[k, 3:], vector)
    # On a table neither the height nor a tilt counts.
    place, turn = np.isin(range(6), robot.base.tip_rows).reshape(2, 3)
    yield _Error(place * errors[0], place * errors[2], path.position_tolerance, "position", "m")
    if path.turns:
        most = path.orientation_tolerance
        yield _Error(turn * errors[1], turn * errors[3], most, "orientation", "rad")


def _least(times: Array, error: _Error) -> Least:
    """Return the least margin of an error below its tolerance."""

    def margins(vectors: Array) -> Array:
        left: Array = error.tolerance - np.linalg.norm(vectors, axis=1)
        return left

    gap = _GAP * error.tolerance
    return least_margin(times, error.vectors, error.rates, margins, gap)[0]


def _failure(samples: Samples, error: _Error, least: Least) -> Failure:
    """Return the failure of an error that exceeds its tolerance, or may."""
    when = samples.at(least.time)
    kind, allowed = error.kind, f"allowed is {error.tolerance:.4g} {error.unit}"
    words = f"the end effector is {error.tolerance - least.found:.4g} {error.unit} off the path"
    if least.found >= 0.0:
        words = (
            f"all that is certain of the end effector's {kind} is that it is within "
            f"{error.tolerance - least.certified:.4g} {error.unit} of the path"
        )
    return Failure(
        Status.LIMIT_VIOLATED,
        f"near {when} {words}, {allowed}",
        (
            f"a larger target.{kind}_tolerance",
            "a longer path in time",
            "more points",
            "another start posture",
            "more planner.joint_spline_spans",
        ),
    )
