"""The goal stays in the view of a camera until it is near, between the points too.

The camera is fixed to a link, so that the goal's place d in the camera's axes changes with the
base and with every joint before the link. With g the gradient of a measure by the goal's place t,
inertial axes, and o the origin of a joint, the measure changes with the joint's angle by
-axis . (t - o) x g, as if the goal turned about the joint the other way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen, grasp_of_path
from ff_planner_ros.planning.distance.moving_place import least_margin, places_between
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.camera import Camera
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

# The search keeps this much more at the points [rad], but never more than this part of the angle.
_MARGIN, _PART = 2e-3, 0.05
# The largest angle is looked for at this number of times in each step of the motion: where the
# goal comes near, the angle changes fast.
_BETWEEN = 50


class CameraView(Requirement):
    """The goal stays in the view of the camera, where there is one."""

    name = "camera"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start with the goal out of view."""
        camera = problem.camera
        if camera is None:
            return
        still = np.zeros((1, problem.robot.model.nv))
        places, _ = _goal_seen(problem, camera, np.zeros(1), q_start[None], still)
        if camera.margins(places)[0] < -LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                "camera.half_angle",
                f"{camera.half_angle:g} rad",
                f"at the start {_words(camera, places[0])}; the start must have the goal in view",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how much further inside the view the search keeps the goal at the points [rad]."""
        return 0.0 if problem.camera is None else min(_MARGIN, _PART * problem.camera.half_angle)

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether a camera has to see the grasp."""
        return problem.camera is not None

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        camera = problem.camera
        if camera is None:
            return ()
        joint, mount = _mount(problem.robot, camera)
        return (
            compiled.goal_in_view(
                grasp_of_path(problem, points).in_core(),
                joint,
                mount.rotation,
                mount.translation,
                camera.axis,
                camera.half_angle,
                camera.until,
                margin,
                OF_INTEREST,
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the certified margin, as an angle at the camera [rad]."""
        if problem.camera is None:
            return np.inf
        least, place = _least(problem, problem.camera, motion.time, motion.q, motion.v)
        away = max(float(np.linalg.norm(place)), abs(least.certified), np.finfo(float).tiny)
        return math.asin(least.certified / away)

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest angle of the goal off the camera's axis, while it must be in view."""
        problem, camera = samples.problem, samples.problem.camera
        if camera is None:
            return Assessment()
        times, *motion = samples.followed_to_goal
        places = places_between(times, *_goal_seen(problem, camera, times, *motion), _BETWEEN)
        far = camera.nearness(places) < 0.0
        found = {"max_view_angle": float(camera.angles(places)[far].max(initial=0.0))}
        least, place = _least(problem, camera, times, *motion)
        if least.certified >= -LIMIT_TOLERANCE:
            return Assessment(found)
        return Assessment(found, (_out_of_view(samples, camera, least, place),))


def _out_of_view(samples: Samples, camera: Camera, least: Least, place: Array) -> Failure:
    """Return the failure of the goal where it is furthest out of view, or may be."""
    when, words = samples.at(least.time), _words(camera, place)
    if least.found >= 0.0:
        return Failure(
            Status.LIMIT_VIOLATED,
            f"the goal may leave the view of the camera near {when}, where {words}: all that "
            f"is certain is a margin of {least.certified * 1e3:.2f} mm",
            ("more points", "a larger camera.half_angle"),
        )
    return Failure(
        Status.LIMIT_VIOLATED,
        f"the goal is out of view at {when}: {words}",
        (
            "a larger camera.half_angle",
            "a larger camera.until",
            "another camera.axis or camera.link",
            "a longer duration",
            "more points",
            "more planner.starts",
        ),
    )


def _mount(robot: Robot, camera: Camera) -> tuple[int, pin.SE3]:
    """Return the frame that a camera's link moves with, 0 is the base, and where it is in it."""
    frame = robot.model.frames[robot.model.getFrameId(camera.link, pin.FrameType.BODY)]
    at_link = pin.SE3(np.eye(3), camera.position)
    # The first two joints are Pinocchio's: the universe and the free-flyer, which is the base.
    return frame.parentJoint - 1, frame.placement * at_link


def _least(
    problem: PlanningProblem, camera: Camera, times: Array, q: Array, v: Array
) -> tuple[Least, Array]:
    """Return the least margin of the goal in the view along a motion, by Pinocchio alone."""
    places, velocities = _goal_seen(problem, camera, times, q, v)
    return least_margin(times, places, velocities, camera.margins)


def _goal_seen(
    problem: PlanningProblem, camera: Camera, times: Array, q: Array, v: Array
) -> tuple[Array, Array]:
    """Return where the goal is in the link's axes, from the camera, and how fast it moves there.

    Args:
        times: From the plan's first point on. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        v: Tangent velocities. Shape (times, 6 + joints).

    Returns:
        Each of shape (times, 3) [m, m/s].
    """
    grasp, model = GraspSeen(problem, times), problem.robot.model
    data, frame = model.createData(), model.getFrameId(camera.link, pin.FrameType.BODY)
    places, velocities = np.empty((len(q), 3)), np.empty((len(q), 3))
    for k, at in enumerate(zip(q, v, strict=True)):
        pin.forwardKinematics(model, data, *at)
        link = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
        in_link = link.actInv(grasp.positions[k])
        places[k] = in_link - camera.position
        velocities[k] = link.rotation.T @ grasp.velocities[k] - twist.linear
        velocities[k] -= np.cross(twist.angular, in_link)
    return places, velocities


def _words(camera: Camera, place: Array) -> str:
    """Return words for where the goal is, seen from the camera."""
    (angle,) = camera.angles(place[None])
    until = f" until it is {camera.until:g} m away" if camera.until else ""
    return (
        f"the camera on {camera.link} sees the goal {math.degrees(angle):.2f} deg off its axis, "
        f"{float(np.linalg.norm(place)):.4f} m away, allowed are "
        f"{math.degrees(camera.half_angle):.4g} deg{until}"
    )
