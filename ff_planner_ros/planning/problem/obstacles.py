"""Spheres that the arm stays out of: at rest, moving uniformly, or fixed to a target body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen, zero_vector
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import NAME, a_number, a_vector
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.target_body import TargetBody


@dataclass(frozen=True, eq=False)
class Sphere:
    """An obstacle: a sphere that the arm's centre lines stay out of.

    It rests, moves uniformly, or is fixed to a target body and moves with it.

    Raises:
        InvalidInput: Wrong size, not finite, or a radius that is not positive.
    """

    id: str = declare(
        NAME,
        "name in messages, unique",
        message="id",
    )
    center: Array = declare(
        a_vector(),
        "at the plan's first point, not when the state was measured",
        unit="m",
        message="center",
    )
    radius: float = declare(
        a_number(above=0.0),
        "obstacle plus link",
        unit="m",
        message="radius",
    )
    # Of one that is fixed to a body, at the plan's first point
    velocity: Array = declare(
        a_vector(),
        "constant",
        unit="m/s",
        since="0.3",
        brief=True,
        default_factory=zero_vector,
        message="twist.linear",
        late=True,
    )
    body: TargetBody | None = None  # that it is fixed to; None: to none
    place_in_body: Array | None = None  # of its centre then; shape (3,) [m]

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, f"obstacles[{self.id}]")

    @property
    def moves(self) -> bool:
        """Whether it is elsewhere later."""
        return self.body is not None or bool(self.velocity.any())

    @property
    def highest_speed(self) -> float:
        """A speed of its centre that it never exceeds [m/s]."""
        if self.body is None or self.place_in_body is None:
            return float(np.linalg.norm(self.velocity))
        drift = float(np.linalg.norm(self.body.linear_velocity))
        return drift + self.body.fastest_turn * float(np.linalg.norm(self.place_in_body))

    @property
    def highest_acceleration(self) -> float:
        """An acceleration of its centre that it never exceeds [m/s2].

        A body's turn rate w changes by less than w^2: by Euler's equations, and as no principal
        moment is larger than the sum of both others.
        """
        if self.body is None or self.place_in_body is None:
            return 0.0
        return 2.0 * self.body.fastest_turn**2 * float(np.linalg.norm(self.place_in_body))

    def way(self, time: float) -> Array:
        """Return how far its centre has come since the plan's first point. Shape (3,) [m]."""
        if self.body is None or self.place_in_body is None:
            uniform: Array = time * self.velocity
            return uniform
        there = self.body.places(self.place_in_body[None], np.array([time]))
        return np.asarray(there[0, 0] - self.center, np.float64)


def sphere_arrays(spheres: Sequence[Sphere]) -> tuple[Array, Array, Array]:
    """Return centres and velocities, shape (spheres, 3) [m, m/s], and radii, (spheres,) [m].

    They are read-only: a search asks for them again and again.
    """
    return _sphere_arrays(tuple(spheres))


@lru_cache(maxsize=8)
def _sphere_arrays(spheres: tuple[Sphere, ...]) -> tuple[Array, Array, Array]:
    centers = np.array([sphere.center for sphere in spheres]).reshape(-1, 3)
    velocities = np.array([sphere.velocity for sphere in spheres]).reshape(-1, 3)
    return frozen(centers), frozen(velocities), frozen([sphere.radius for sphere in spheres])


def carried_spheres(spheres: tuple[Sphere, ...], time: float) -> tuple[Sphere, ...]:
    """Return spheres that rest or move uniformly as they will be in a time [s]."""
    if not any(sphere.moves for sphere in spheres):
        return spheres
    return tuple(replace(one, center=one.center + one.way(time)) for one in spheres)


def with_attached_spheres(obstacles: Sequence[Sphere], body: TargetBody) -> tuple[Sphere, ...]:
    """Return obstacles, and what is fixed to a body behind them.

    Raises:
        InvalidInput: One of these has the name of an obstacle.
    """
    names, attached = {sphere.id for sphere in obstacles}, tuple(attached_spheres(body))
    for index, sphere in enumerate(attached):
        if sphere.id in names:
            field, allowed = f"target_body.obstacles[{index}].id", "an obstacle has it, too"
            raise InvalidInput(Status.OUT_OF_RANGE, field, sphere.id, allowed)
    return (*obstacles, *attached)


def attached_spheres(body: TargetBody) -> Iterator[Sphere]:
    """Yield what is fixed to a body as obstacles of a problem."""
    for sphere in body.obstacles:
        motion = body.motion(sphere.center, np.zeros(1))
        center, velocity = motion.positions[0], motion.twists[0, :3]
        yield Sphere(sphere.id, center, sphere.radius, velocity, body, sphere.center)
