"""The scene of a plan: obstacles, target and constraints, for simulations and reports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.path.followed import PathToFollow
from ff_planner_ros.planning.problem.problem import (
    CONTACT_DISTANCE,
    Obstacle,
    PlanningProblem,
    Target,
    attached,
)
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.quaternion import (
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)


class GraspFrame(NamedTuple):
    """The grasp frame in the inertial frame at some times."""

    positions: Array  # of its origin; shape (times, 3) [m]
    rotations: Array  # to inertial axes; shape (times, 3, 3)
    twists: Array  # linear part first, inertial axes; shape (times, 6) [m/s, rad/s]


def grasp_frame(target: Target | TargetBody, captured: float, times: Array) -> GraspFrame:
    """Return the frame of a target that moves uniformly, or that of a body's grasp.

    Args:
        captured: Time of the target's pose [s].
        times: From the plan's first point on. Shape (times,) [s].
    """
    if isinstance(target, TargetBody):
        grasp = target.grasp(times)
        return GraspFrame(grasp.positions, grasp.rotations, grasp.twists)
    later = times - captured
    turned = quaternion_from_rotation_vector(np.outer(later, target.angular_velocity))
    at_goal = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    twist = np.concatenate([target.linear_velocity, target.angular_velocity])
    return GraspFrame(
        positions=target.position + np.outer(later, target.linear_velocity),
        rotations=rotation_from_quaternion(turned) @ at_goal,
        twists=np.broadcast_to(twist, (len(times), 6)),
    )


@dataclass(frozen=True, eq=False)
class Scene:
    """Obstacles, target and constraints that a plan was made for, in its inertial frame."""

    obstacles: Sequence[Obstacle] = ()
    # `link/obstacle` or `link/link`: they may touch once the end effector stays within the contact
    # distance of the target and, if they touch at the start, until it is that far from there
    allowed_collisions: Sequence[str] = ()
    contact_distance: float = CONTACT_DISTANCE  # [m]
    # At the capture; it moves uniformly before and after. None: not known, or the grasp of a body
    target: Target | None = None
    target_body: TargetBody | None = None  # whose grasp is the target, if any
    capture_time: float | None = None  # from the plan's first point on [s]; None: at its last
    # Time from which the end effector holds the target body in later phases; infinite: never [s]
    held_from: float = math.inf
    approach: Approach | None = None  # of the last stretch to the target, if any
    camera: Camera | None = None  # that keeps the target in view, if any
    path: PathToFollow | None = None  # that leads to the target, from the first point on, if any

    __repr__ = in_a_line

    @property
    def goal(self) -> Target | None:
        """Goal of the end effector at the capture; None: not known."""
        if self.target_body is None:
            return self.target
        return None if self.capture_time is None else self.target_body.target(self.capture_time)

    @property
    def constraints(self) -> dict[str, Approach | Camera]:
        """Approach and camera, those that there are, by the name of their field."""
        every = {"approach": self.approach, "camera": self.camera}
        return {name: kept for name, kept in every.items() if kept is not None}

    def captured_at(self, duration: float) -> Scene:
        """Return the scene with a capture time: a plan's duration [s], unless it has one."""
        told = self.capture_time
        return replace(self, capture_time=duration if told is None else told)

    def targets(self, times: Array) -> Array | None:
        """Return the positions of the target, (times, 3) [m]; None: not known.

        Args:
            times: Without a capture time, up to that of the plan's last point. Shape (times,) [s].
        """
        goal = self.target_body or self.target
        captured = float(times[-1]) if self.capture_time is None else self.capture_time
        return None if goal is None else grasp_frame(goal, captured, times).positions

    def seen_from(self, origin: Array, velocity: Array) -> Scene:
        """Return the scene in a frame with this origin [m] at time zero and velocity [m/s].

        Raises:
            InvalidInput: It has a target without a capture time: see `captured_at`.
        """
        body = None if self.target_body is None else self.target_body.seen_from(origin, velocity)
        free = [_seen_from(one, origin, velocity) for one in self.obstacles if one.body is None]
        target = self.target
        if target is not None:
            if self.capture_time is None:
                allowed = "where a target is depends on it"
                raise InvalidInput(Status.OUT_OF_RANGE, "capture_time", "missing", allowed)
            way = origin + self.capture_time * velocity
            target = replace(
                target,
                position=target.position - way,
                linear_velocity=target.linear_velocity - velocity,
            )
        path = self.path
        if path is not None:
            path = path.moved(lambda at, time: at - origin - time * velocity)
        return replace(
            self,
            obstacles=(*free, *(() if body is None else attached(body))),
            target=target,
            target_body=body,
            path=path,
        )


def _seen_from(one: Obstacle, origin: Array, velocity: Array) -> Obstacle:
    place, going = one.motion.position - origin, one.motion.velocity - velocity
    return one.with_motion(position=place, velocity=going)


# Fields that a problem has, too, with the same values.
OF_PROBLEM = tuple(
    item.name
    for item in fields(Scene)
    if item.name not in ("obstacles", "target", "target_body", "capture_time", "held_from")
)


def scene_of(problem: PlanningProblem) -> Scene:
    """Return the scene of a problem."""
    return Scene(
        obstacles=problem.obstacles,
        target=problem.target if problem.target_body is None and problem.posture is None else None,
        target_body=problem.target_body,
        capture_time=problem.duration,
        **{name: getattr(problem, name) for name in OF_PROBLEM},
    )
