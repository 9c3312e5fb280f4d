"""Obstacles: spheres, and convex bodies of other shapes.

They rest, move uniformly, rotate at a constant angular velocity (bodies only), or are fixed to a
target body.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, finite_vector, frozen, no_turn
from ff_planner_ros.common.declared import check_declared, declare, declare_velocity
from ff_planner_ros.common.declared_parts import one_of_parts, part
from ff_planner_ros.common.forms import NAME, QUATERNION, Form, a_number, a_vector
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.target_body import (
    MOST_TURNS,
    AttachedBody,
    AttachedSphere,
    TargetBody,
)
from ff_planner_ros.robot.collision.solids import SHAPE, SHAPE_SENTENCE, MeshFile, Solid
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.quaternion import rotation_from_quaternion
from ff_planner_ros.robot.rotation import cross
from ff_planner_ros.robot.urdf.meshes import Meshes


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere that rests, moves uniformly, or is fixed to a target body and moves with it.

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
    velocity: Array = declare_velocity("linear", "constant", brief=True)
    body: TargetBody | None = None  # that it is fixed to, if any
    place_in_body: Array | None = None  # of its centre then, in the body's frame; shape (3,) [m]

    FACTS = ("id", "center", "radius", "velocity")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, f"obstacles[{self.id}]", body=TargetBody)
        if self.place_in_body is not None:
            place = finite_vector("place_in_body", self.place_in_body, 3)
            object.__setattr__(self, "place_in_body", place)

    @property
    def moves(self) -> bool:
        """Whether its centre moves."""
        return self.body is not None or bool(self.velocity.any())

    @property
    def highest_speed(self) -> float:
        """Upper bound of the speed of its centre [m/s]."""
        if self.body is None or self.place_in_body is None:
            return float(np.linalg.norm(self.velocity))
        drift = float(np.linalg.norm(self.body.linear_velocity))
        return drift + self.body.fastest_turn * float(np.linalg.norm(self.place_in_body))

    @property
    def highest_acceleration(self) -> float:
        """Upper bound of the acceleration of its centre [m/s2].

        |w'| <= w^2 for the angular velocity w of a free body, by Euler's equations, as no principal
        moment is larger than the sum of both others.
        """
        if self.body is None or self.place_in_body is None:
            return 0.0
        return 2.0 * self.body.fastest_turn**2 * float(np.linalg.norm(self.place_in_body))

    def after(self, time: float) -> Sphere:
        """Return the sphere as it will be after a time [s], with the body that it is fixed to."""
        there = replace(self, center=self.center + self.way(time))
        if self.body is None or self.place_in_body is None:
            return there
        motion = self.body.motion(self.place_in_body, np.array([time]))
        return replace(there, velocity=motion.twists[0, :3], body=self.body.after(time))

    def way(self, time: float) -> Array:
        """Return the displacement of its centre since the plan's first point. Shape (3,) [m]."""
        if self.body is None or self.place_in_body is None:
            uniform: Array = time * self.velocity
            return uniform
        there = self.body.places(self.place_in_body[None], np.array([time]))
        return np.asarray(there[0, 0] - self.center, np.float64)


@dataclass(frozen=True, eq=False)
class ObstacleBody:
    """An obstacle of any convex shape.

    It rests, moves uniformly and rotates at a constant angular velocity about the origin of its
    shape's frame, or is fixed to a target body and moves with it.

    Raises:
        InvalidInput: Wrong size, not finite, or a quaternion not of unit length.
    """

    id: str = declare(NAME, "name in messages, unique", message="id")
    shape: Solid | MeshFile = declare(
        SHAPE,
        SHAPE_SENTENCE,
        unit="m",
    )
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
    velocity: Array = declare_velocity("linear", "constant", brief=True)
    angular_velocity: Array = declare_velocity("angular", "in inertial axes, constant", brief=True)
    body: TargetBody | None = None  # that it is fixed to, if any
    place_in_body: pin.SE3 | None = None  # of the shape's frame then, in the body's frame

    FACTS = ("id", "shape", "position", "velocity", "angular_velocity")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, f"obstacles[{self.id}]", body=TargetBody, place_in_body=pin.SE3)

    @property
    def solid(self) -> Solid:
        """Its shape.

        Raises:
            InvalidInput: The shape is a mesh file that has not been read.
        """
        if isinstance(self.shape, MeshFile):
            told, allowed = f"obstacles[{self.id}].shape", "its file must be read before"
            raise InvalidInput(Status.UNSUPPORTED, told, self.shape.file, allowed)
        return self.shape

    @property
    def moves(self) -> bool:
        """Whether its pose changes."""
        return self.turns or bool(self.velocity.any())

    @cached_property
    def highest_speed(self) -> float:
        """Upper bound of the speed of all its points [m/s]."""
        reach = self.solid.reach
        if self.body is None or self.place_in_body is None:
            turn = float(np.linalg.norm(self.angular_velocity))
            return float(np.linalg.norm(self.velocity)) + turn * reach
        drift = float(np.linalg.norm(self.body.linear_velocity))
        arm = float(np.linalg.norm(self.place_in_body.translation))
        return drift + self.body.fastest_turn * (arm + reach)

    @cached_property
    def rotation(self) -> Array:
        """Its axes to inertial axes at the plan's first point. Shape (3, 3)."""
        return frozen(rotation_from_quaternion(self.quaternion_xyzw))

    @property
    def turns(self) -> bool:
        """Whether its attitude changes."""
        return self.body is not None or bool(self.angular_velocity.any())

    def poses(self, times: Array) -> tuple[Array, Array]:
        """Return its axes to inertial axes, (times, 3, 3), and its origin, (times, 3) [m].

        Args:
            times: From the plan's first point on. Shape (times,) [s].
        """
        if self.body is not None and self.place_in_body is not None:
            motion = self.body.motion(self.place_in_body.translation, times)
            return motion.rotations @ self.place_in_body.rotation, motion.positions
        positions = self.position + times[:, None] * self.velocity
        if not self.turns:
            return np.broadcast_to(self.rotation, (len(times), 3, 3)), positions
        turned = [pin.exp3(time * self.angular_velocity) for time in times]
        return np.array(turned).reshape(-1, 3, 3) @ self.rotation, positions

    def twists(self, times: Array) -> Array:
        """Return the twists of its origin, linear part first, inertial axes. Shape (times, 6)."""
        if self.body is not None and self.place_in_body is not None:
            return self.body.motion(self.place_in_body.translation, times).twists
        twist = np.concatenate([self.velocity, self.angular_velocity])
        return np.broadcast_to(twist, (len(times), 6))

    def after(self, time: float) -> ObstacleBody:
        """Return the obstacle as it will be after a time [s], with the body that it is fixed to."""
        if time == 0.0:
            return self  # to the last bit
        rotations, positions = self.poses(np.array([time]))
        turned = eigen_quaternion(rotations[0]) if self.turns else self.quaternion_xyzw
        there = replace(self, position=positions[0], quaternion_xyzw=turned)
        if self.body is None:
            return there
        linear, angular = np.split(self.twists(np.array([time]))[0], 2)
        return replace(there, velocity=linear, angular_velocity=angular, body=self.body.after(time))


def require_foretold(obstacles: Sequence[ObstacleBody], until: float) -> None:
    """Refuse obstacles whose own rotation until a time [s] is too far to be predicted.

    Raises:
        InvalidInput: One rotates by more than `MOST_TURNS`; the error names it.
    """
    for one in obstacles:
        turns = float(np.linalg.norm(one.angular_velocity)) * until
        if one.body is None and not turns <= MOST_TURNS:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                f"obstacles[{one.id}].angular_velocity",
                one.angular_velocity.tolist(),
                f"within {until:.6g} s the body turns too far to be foretold, by {turns:.3g} rad; "
                f"{MOST_TURNS:g} rad are allowed",
            )


Obstacle: TypeAlias = Sphere | ObstacleBody
Kind = TypeVar("Kind", Sphere, ObstacleBody, Obstacle)
InTheWay: TypeAlias = Obstacle | AttachedSphere | AttachedBody


def spheres_in(obstacles: Sequence[Obstacle]) -> tuple[Sphere, ...]:
    """Return the spheres among obstacles."""
    return tuple(one for one in obstacles if isinstance(one, Sphere))


def bodies_in(obstacles: Sequence[Obstacle]) -> tuple[ObstacleBody, ...]:
    """Return the bodies among obstacles."""
    return tuple(one for one in obstacles if isinstance(one, ObstacleBody))


def with_mesh_read(one: InTheWay, told: str, meshes: Meshes) -> InTheWay:
    """Return an obstacle with its mesh file read, or as a `Sphere` if its shape is one.

    Args:
        told: Name of its field in errors.
        meshes: Reads mesh files.

    Raises:
        InvalidInput: The file cannot be read, or its mesh has no convex hull.
    """
    if isinstance(one, ObstacleBody | AttachedBody) and isinstance(one.shape, MeshFile):
        one = replace(one, shape=one.shape.load(f"{told}.shape.mesh", meshes))
    return simplest(one) if isinstance(one, ObstacleBody) else one


def simplest(one: Obstacle) -> Obstacle:
    """Return an obstacle as it is, or as a `Sphere` if it is a body of that shape."""
    if isinstance(one, Sphere) or one.solid.kind != "sphere":
        return one
    radius = float(one.solid.sizes[0]) + one.solid.grown
    place = None if one.place_in_body is None else one.place_in_body.translation
    return Sphere(one.id, one.position, radius, one.velocity, one.body, place)


def carried(obstacles: Sequence[Kind], time: float) -> tuple[Kind, ...]:
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
    to_inertial, rate = rotation_from_quaternion(body.quaternion_xyzw), body.angular_velocity
    for one in body.obstacles:
        place = one.position if isinstance(one, AttachedBody) else one.center
        lever = to_inertial @ place
        at, velocity = body.position + lever, body.linear_velocity + cross(rate, lever)
        if isinstance(one, AttachedBody):
            turn = rotation_from_quaternion(one.quaternion_xyzw)
            attitude, in_body = eigen_quaternion(to_inertial @ turn), pin.SE3(turn, place)
            yield simplest(
                ObstacleBody(one.id, one.shape, at, attitude, velocity, rate, body, in_body)
            )
        else:
            yield Sphere(one.id, at, one.radius, velocity, body, place)


# An obstacle in a file has a key `shape` if it is a body, and a centre and radius if a sphere
OBSTACLE: Form = one_of_parts("shape", part(ObstacleBody), part(Sphere))
