"""What a plan was made among, for those who look at it afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.problem import CONTACT_DISTANCE, PlanningProblem, Sphere


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

    def seen_from(self, origin: Array, velocity: Array) -> Scene:
        """Return the scene in a frame that moves, without turning."""
        return replace(
            self,
            obstacles=[
                replace(one, center=one.center - origin, velocity=one.velocity - velocity)
                for one in self.obstacles
            ],
            target=None if self.target is None else self.target - origin,
            drift=self.drift - velocity,
        )


def scene_of(problem: PlanningProblem) -> Scene:
    """Return the scene of a problem."""
    return Scene(
        obstacles=problem.obstacles,
        allowed_at_goal=problem.allowed_at_goal,
        contact_distance=problem.contact_distance,
        target=problem.target.position,
    )
