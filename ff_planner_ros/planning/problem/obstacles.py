"""Obstacles: convex solids, each with a rigid motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen, no_turn, zero_vector
from ff_planner_ros.common.declared import (
    check_declared,
    declare,
    declare_inline,
    declare_velocity,
)
from ff_planner_ros.common.declared_parts import part_or_entry
from ff_planner_ros.common.forms import QUATERNION, Form, a_vector
from ff_planner_ros.common.plain_values import of_checked
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.target_body import (
    MOST_TURNS,
    AttachedSphereEntry,
    TargetBody,
)
from ff_planner_ros.robot.collision.solids import Shaped
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.quaternion import rotation_from_quaternion
from ff_planner_ros.robot.rotation import cross

_NOT_TURNED, _UPRIGHT, _STILL = frozen(np.eye(3)), frozen(no_turn()), frozen(zero_vector())


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """The motion of a frame: uniform with a constant angular velocity, or that of a target body.

    Raises:
        InvalidInput: Wrong size, not finite, or a quaternion not of unit length.
    """

    position: Array = declare(
        a_vector(),
        "of the shape's frame, at the plan's first point",
        unit="m",
        message="pose.position",
    )
    quaternion_xyzw: Array = declare(
        QUATERNION,
        "axes of the shape to inertial axes, at the plan's first point",
        default_factory=no_turn,
        message="pose.orientation",
    )
    # Of a frame that is fixed to a body, at the plan's first point
    velocity: Array = declare_velocity("linear", "constant", brief=True)
    angular_velocity: Array = declare_velocity("angular", "in inertial axes, constant", brief=True)
    body: TargetBody | None = None  # that the frame is fixed to, if any
    place_in_body: pin.SE3 | None = None  # of the frame then, in the body's frame

    FACTS = ("position", "velocity", "angular_velocity")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, "motion", body=TargetBody, place_in_body=pin.SE3)

    @classmethod
    def fixed_to(cls, body: TargetBody, place: pin.SE3) -> RigidMotion:
        """Return the motion of a frame that is fixed to a body, at a place in the body's frame."""
        to_inertial, rate = rotation_from_quaternion(body.quaternion_xyzw), body.angular_velocity
        lever = to_inertial @ place.translation
        return cls(
            position=body.position + lever,
            quaternion_xyzw=eigen_quaternion(to_inertial @ place.rotation),
            velocity=body.linear_velocity + cross(rate, lever),
            angular_velocity=rate,
            body=body,
            place_in_body=place,
        )

    @property
    def moves(self) -> bool:
        """Whether the pose changes."""
        return self.turns or bool(self.velocity.any())

    @property
    def turns(self) -> bool:
        """Whether the attitude changes."""
        return self.body is not None or bool(self.angular_velocity.any())

    @property
    def has_attitude(self) -> bool:
        """Whether its axes are not those of the inertial frame all the time."""
        return self.turns or bool(self.quaternion_xyzw[:3].any())

    @cached_property
    def rotation(self) -> Array:
        """Its axes to inertial axes at the plan's first point. Shape (3, 3)."""
        if not self.quaternion_xyzw[:3].any():
            return _NOT_TURNED
        return frozen(rotation_from_quaternion(self.quaternion_xyzw))

    @property
    def highest_rate(self) -> float:
        """Upper bound of the angular velocity [rad/s]."""
        if self.body is None:
            return float(np.linalg.norm(self.angular_velocity))
        return self.body.fastest_turn

    @property
    def lever(self) -> Array:
        """Its origin in the frame of the body that it is fixed to, zero without. Shape (3,) [m]."""
        return np.zeros(3) if self.place_in_body is None else self.place_in_body.translation

    def highest_speed(self, reach: float) -> float:
        """Return an upper bound of the speed of points within a reach [m] of the origin [m/s]."""
        drift = self.velocity if self.body is None else self.body.linear_velocity
        lever = float(np.linalg.norm(self.lever)) + reach
        return float(np.linalg.norm(drift)) + self.highest_rate * lever

    def highest_acceleration(self, reach: float) -> float:
        """Return an upper bound of the acceleration of points within a reach [m/s2].

        The angular acceleration of a free body is at most the square of its angular velocity, by
        Euler's equations, as no principal moment is larger than the sum of both others.
        """
        return 2.0 * self.highest_rate**2 * (float(np.linalg.norm(self.lever)) + reach)

    def poses(self, times: Array) -> tuple[Array, Array]:
        """Return its axes to inertial axes, (times, 3, 3), and its origin, (times, 3) [m].

        Args:
            times: From the plan's first point on. Shape (times,) [s].
        """
        if self.body is not None and self.place_in_body is not None:
            motion = self.body.motion(self.lever, times)
            return motion.rotations @ self.place_in_body.rotation, motion.positions
        positions = self.position + times[:, None] * self.velocity
        if not self.turns:
            return np.broadcast_to(self.rotation, (len(times), 3, 3)), positions
        turned = [pin.exp3(time * self.angular_velocity) for time in times]
        return np.array(turned).reshape(-1, 3, 3) @ self.rotation, positions

    def twists(self, times: Array) -> Array:
        """Return the twists of its origin, linear part first, inertial axes. Shape (times, 6)."""
        if self.body is not None:
            return self.body.motion(self.lever, times).twists
        twist = np.concatenate([self.velocity, self.angular_velocity])
        return np.broadcast_to(twist, (len(times), 6))

    def way(self, time: float) -> Array:
        """Return the displacement of its origin since the plan's first point. Shape (3,) [m]."""
        if self.body is None:
            uniform: Array = time * self.velocity
            return uniform
        there = self.body.places(self.lever[None], np.array([time]))
        return np.asarray(there[0, 0] - self.position, np.float64)

    def after(self, time: float) -> RigidMotion:
        """Return the motion from a time [s] on, with the body that the frame is fixed to."""
        if time == 0.0:
            return self  # to the last bit
        if self.body is not None and self.place_in_body is not None:
            return RigidMotion.fixed_to(self.body.after(time), self.place_in_body)
        (rotation,), (position,) = self.poses(np.array([time]))
        turned = eigen_quaternion(rotation) if self.turns else self.quaternion_xyzw
        return replace(self, position=position, quaternion_xyzw=turned)


@dataclass(frozen=True, eq=False)
class Obstacle(Shaped):
    """A convex solid that rests, moves uniformly, rotates, or is fixed to a target body.

    Raises:
        InvalidInput: A value of wrong kind, or a name that is no text.
    """

    PLACE: ClassVar[str] = "obstacles"

    motion: RigidMotion = declare_inline(RigidMotion)  # of the shape's frame

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value; a sphere keeps no attitude of its own."""
        check_declared(self, f"{self.PLACE}[{self.id}]", motion=RigidMotion)
        motion = self.motion
        if self.is_sphere and self.body is None and motion.has_attitude:
            still = RigidMotion(motion.position, velocity=motion.velocity)
            object.__setattr__(self, "motion", still)

    @classmethod
    def sphere(
        cls, name: str, center: Array, radius: float, velocity: Array | None = None
    ) -> Obstacle:
        """Return a sphere that rests or moves uniformly.

        Args:
            name: Its id, unique.
            center: At the plan's first point, in the inertial frame. Shape (3,) [m].
            radius: Of obstacle plus link [m].
            velocity: Shape (3,) [m/s]. None: it rests.

        Raises:
            InvalidInput: Wrong size, not finite, or a radius out of range.
        """
        going = zero_vector() if velocity is None else velocity
        made: Obstacle = SphereEntry(name, center, radius, going).made()
        return made

    @property
    def center(self) -> Array:
        """Centre of `radius` at the plan's first point, in the inertial frame. Shape (3,) [m]."""
        there: Array = self.motion.position + self.motion.rotation @ self.solid.center
        return there

    @property
    def body(self) -> TargetBody | None:
        """The target body that it is fixed to, if any."""
        return self.motion.body

    @property
    def moves(self) -> bool:
        """Whether its pose changes."""
        return self.motion.moves

    @property
    def reach(self) -> float:
        """Upper bound of the distance of points that count from its origin: of a sphere, zero [m].

        A point of a sphere is its radius away from the centre, whatever the attitude.
        """
        return 0.0 if self.is_sphere else self.solid.reach

    @property
    def highest_speed(self) -> float:
        """Upper bound of the speed of all its points; of a sphere, of its centre [m/s]."""
        return self.motion.highest_speed(self.reach)

    def with_motion(self, **changes: Any) -> Obstacle:
        """Return the obstacle with changes of its motion, as `replace` takes them."""
        return replace(self, motion=replace(self.motion, **changes))

    def after(self, time: float) -> Obstacle:
        """Return the obstacle as it will be after a time [s], with the body that it is fixed to."""
        return replace(self, motion=self.motion.after(time))


@dataclass(frozen=True, eq=False)
class SphereEntry(AttachedSphereEntry):
    """A sphere that is not fixed to a target body, as files and messages have it."""

    PLACE: ClassVar[str] = Obstacle.PLACE

    center: Array = declare(
        a_vector(),
        "at the plan's first point, not when the state was measured",
        unit="m",
        message="center",
    )
    velocity: Array = declare_velocity("linear", "constant", brief=True)

    @classmethod
    def of(cls, one: Any) -> SphereEntry:
        """Return the entry of an obstacle that is a sphere."""
        return cls(one.id, one.motion.position, one.radius, one.motion.velocity)

    def made(self) -> Any:
        """Return the obstacle."""
        motion = of_checked(
            RigidMotion,
            position=self.center,
            quaternion_xyzw=_UPRIGHT,
            velocity=self.velocity,
            angular_velocity=_STILL,
            body=None,
            place_in_body=None,
        )
        return of_checked(Obstacle, id=self.id, shape=self.solid, motion=motion)


# An obstacle in a file has a key `shape`, or a centre and radius
OBSTACLE: Form = part_or_entry("shape", Obstacle, SphereEntry)


def require_foretold(obstacles: Sequence[Obstacle], until: float) -> None:
    """Refuse obstacles whose own rotation until a time [s] is too far to be predicted.

    Raises:
        InvalidInput: One rotates by more than `MOST_TURNS`; the error names it.
    """
    for one in obstacles:
        turns = one.motion.highest_rate * until
        if one.body is None and not turns <= MOST_TURNS:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                f"obstacles[{one.id}].angular_velocity",
                one.motion.angular_velocity.tolist(),
                f"within {until:.6g} s the body turns too far to be foretold, by {turns:.3g} rad; "
                f"{MOST_TURNS:g} rad are allowed",
            )


def carried(obstacles: Sequence[Obstacle], time: float) -> tuple[Obstacle, ...]:
    """Return obstacles as they will be after a time [s]."""
    return tuple(one.after(time) if one.moves else one for one in obstacles)


def with_attached(obstacles: Sequence[Obstacle], body: TargetBody) -> tuple[Obstacle, ...]:
    """Return obstacles, then those that are fixed to a body.

    Raises:
        InvalidInput: An attached obstacle has the id of another obstacle.
    """
    names, fixed = {one.id for one in obstacles}, tuple(attached(body))
    for index, one in enumerate(fixed):
        if one.id in names:
            field, allowed = f"target_body.obstacles[{index}].id", "an obstacle has it, too"
            raise InvalidInput(Status.OUT_OF_RANGE, field, one.id, allowed)
    return (*obstacles, *fixed)


def attached(body: TargetBody) -> Iterator[Obstacle]:
    """Yield the obstacles of a problem that are fixed to a body."""
    for one in body.obstacles:
        place = pin.SE3(rotation_from_quaternion(one.quaternion_xyzw), one.position)
        yield Obstacle(one.id, one.shape, RigidMotion.fixed_to(body, place))
