"""What a plan was made among, for those who look at it afterwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.obstacles import ObstacleBody, bodies_in, spheres_in
from ff_planner_ros.planning.problem.problem import (
    CONTACT_DISTANCE,
    Obstacle,
    PlanningProblem,
    Sphere,
    Target,
    attached,
)
from ff_planner_ros.planning.problem.target_body import TargetBody


@dataclass(frozen=True, eq=False)
class Scene:
    """What a plan was made among, in the plan's inertial frame."""

    obstacles: Sequence[Obstacle] = ()
    # `link/obstacle` or `link/link`: they may touch from when on the end effector stays within the
    # contact distance of the target, and if they do at the start, until it is further from there
    allowed_collisions: Sequence[str] = ()
    contact_distance: float = CONTACT_DISTANCE  # [m]
    # As it is at the capture, and goes on uniformly before and after; None: not known, or a body's
    target: Target | None = None
    target_body: TargetBody | None = None  # whose grasp the target is; None: of none
    capture_time: float | None = None  # from the plan's first point on [s]; None: at its last
    # From when on the end effector holds it: a phase follows; infinite: it is never held [s]
    held_from: float = math.inf
    approach: Approach | None = None  # of the last stretch to the target; None: any way
    camera: Camera | None = None  # that keeps the target in view; None: none

    @property
    def goal(self) -> Target | None:
        """Goal of the end effector at the capture; None: not known."""
        if self.target_body is None:
            return self.target
        return None if self.capture_time is None else self.target_body.target(self.capture_time)

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """The spheres among the obstacles."""
        return spheres_in(self.obstacles)

    @property
    def obstacle_bodies(self) -> tuple[ObstacleBody, ...]:
        """The other obstacles, which have shapes."""
        return bodies_in(self.obstacles)

    @property
    def constraints(self) -> dict[str, Approach | Camera]:
        """What the robot keeps on its way to the goal, by the name of the field."""
        every = {"approach": self.approach, "camera": self.camera}
        return {name: kept for name, kept in every.items() if kept is not None}

    def captured_at(self, duration: float) -> Scene:
        """Return the scene with the time of the capture: a plan's duration [s], if none is told."""
        told = self.capture_time
        return replace(self, capture_time=duration if told is None else told)

    def targets(self, times: Array) -> Array | None:
        """Return where the target is at some times, shape (times, 3) [m]; None: not known."""
        if self.target_body is not None:
            return self.target_body.grasp(times).positions
        if self.target is None:
            return None
        later = times - (self.capture_time or 0.0)
        return self.target.position + np.outer(later, self.target.linear_velocity)

    def seen_from(self, origin: Array, velocity: Array) -> Scene:
        """Return the scene in a frame that moves, without turning."""
        body = None if self.target_body is None else self.target_body.seen_from(origin, velocity)
        free = [_seen_from(one, origin, velocity) for one in self.obstacles if one.body is None]
        target = self.target
        if target is not None:
            way = origin + (self.capture_time or 0.0) * velocity
            target = replace(
                target,
                position=target.position - way,
                linear_velocity=target.linear_velocity - velocity,
            )
        return replace(
            self,
            obstacles=(*free, *(() if body is None else attached(body))),
            target=target,
            target_body=body,
        )


def _seen_from(one: Obstacle, origin: Array, velocity: Array) -> Obstacle:
    if isinstance(one, Sphere):
        return replace(one, center=one.center - origin, velocity=one.velocity - velocity)
    return replace(one, position=one.position - origin, velocity=one.velocity - velocity)


# Fields that are the same in a problem, and need nothing but the problem's request to be known.
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
