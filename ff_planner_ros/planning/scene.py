"""What a plan was made among, for those who look at it afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.problem import (
    CONTACT_DISTANCE,
    PlanningProblem,
    Sphere,
    attached_spheres,
)
from ff_planner_ros.planning.target_body import TargetBody


@dataclass(frozen=True, eq=False)
class Scene:
    """What a plan was made among, in the plan's inertial frame."""

    obstacles: Sequence[Sphere] = ()
    # `link/obstacle` or `link/link`: they may touch from when on the end effector stays within the
    # contact distance of the target
    allowed_at_goal: Sequence[str] = ()
    contact_distance: float = CONTACT_DISTANCE  # [m]
    target: Array | None = None  # at the plan's first point; shape (3,) [m]; None: not known
    drift: Array = field(default_factory=lambda: np.zeros(3))  # of the target; shape (3,) [m/s]
    target_body: TargetBody | None = None  # whose grasp the target is; None: of none
    capture_time: float | None = None  # from the plan's first point on [s]; None: at its last

    def targets(self, times: Array) -> Array | None:
        """Return where the target is at some times, shape (times, 3) [m]; None: not known."""
        if self.target_body is not None:
            return self.target_body.grasp(times).positions
        return None if self.target is None else self.target + np.outer(times, self.drift)

    def seen_from(self, origin: Array, velocity: Array) -> Scene:
        """Return the scene in a frame that moves, without turning."""
        body = None if self.target_body is None else self.target_body.seen_from(origin, velocity)
        free = [
            replace(one, center=one.center - origin, velocity=one.velocity - velocity)
            for one in self.obstacles
            if one.body is None
        ]
        return replace(
            self,
            obstacles=(*free, *(() if body is None else attached_spheres(body))),
            target=None if self.target is None else self.target - origin,
            drift=self.drift - velocity,
            target_body=body,
        )


def scene_of(problem: PlanningProblem) -> Scene:
    """Return the scene of a problem."""
    return Scene(
        obstacles=problem.obstacles,
        allowed_at_goal=problem.allowed_at_goal,
        contact_distance=problem.contact_distance,
        target=problem.target.position,
        target_body=problem.target_body,
        capture_time=problem.duration,
    )
