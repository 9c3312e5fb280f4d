"""A target that drifts and tumbles freely until it is captured.

Its centre of mass moves uniformly, and it rotates by Euler's equations without torque. The grasp
and the attached obstacles move with it: for a point r in body axes,

    p = c + R r,    v = c' + w x R r,    a = w' x R r + w x (w x R r).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.common.declared import check_declared, declare, declare_velocity
from ff_planner_ros.common.declared_parts import part_or_entry
from ff_planner_ros.common.forms import INERTIA, NAME, QUATERNION, a_number, a_vector, each
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.planning.problem.torque_free import (
    PointMotion,
    TorqueFreeMotion,
    Turning,
    fastest_turn,
    possible_inertia,
)
from ff_planner_ros.robot.collision.solids import RADIUS, Solid, in_order
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.rotation import cross
from ff_planner_ros.robot.urdf.payload import HeldShape

# After a larger rotation [rad] no grasp can be predicted: with an angular velocity that is known to
# 0.1 % it is off by 1 rad. At 10 deg/s that takes more than an hour and a half.
MOST_TURNS = 1000.0


class AttachedObstacle(HeldShape):
    """A convex solid that is fixed to a target body, in the body's frame."""

    PLACE: ClassVar[str] = "target_body.obstacles"

    @classmethod
    def sphere(cls, name: str, center: Array, radius: float) -> AttachedObstacle:
        """Return a sphere by its centre, in the body's frame, shape (3,), and its radius [m]."""
        made: AttachedObstacle = AttachedSphereEntry(name, center, radius).made()
        return made


@dataclass(frozen=True, eq=False)
class AttachedSphereEntry:
    """A sphere that is fixed to a target body, as files and messages have it."""

    PLACE: ClassVar[str] = AttachedObstacle.PLACE

    id: str = declare(NAME, "name in messages and errors, unique", message="id")
    center: Array = declare(
        a_vector(),
        "from the body's centre of mass",
        unit="m",
        frame="in the body's frame",
        message="center",
    )
    radius: float = declare(RADIUS, "obstacle plus link", unit="m", message="radius")

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, f"{self.PLACE}[{self.id}]")

    @property
    def solid(self) -> Solid:
        """The sphere as a solid."""
        return Solid.of_radius(self.radius)

    @classmethod
    def of(cls, one: Any) -> AttachedSphereEntry:
        """Return the entry of an obstacle that is a sphere."""
        return cls(one.id, one.position, one.radius)

    def made(self) -> Any:
        """Return the obstacle."""
        return AttachedObstacle(self.id, self.solid, self.center)


@dataclass(frozen=True, eq=False)
class TargetBody:
    """A freely moving body at the plan's first point, in the inertial frame.

    Raises:
        InvalidInput: Wrong size, not finite, a quaternion not of unit length, an inertia that no
            body has, two attached obstacles with one id, or a grasp inside an attached sphere.
            Its motion raises it, too, at times by which the body rotates by over `MOST_TURNS`.
    """

    FIRST: ClassVar[Sequence[str]] = (
        "position",
        "quaternion_xyzw",
        "linear_velocity",
        "angular_velocity",
    )

    position: Array = declare(
        a_vector(), "of its centre of mass", unit="m", message="pose.position"
    )
    quaternion_xyzw: Array = declare(
        QUATERNION, "body axes to inertial axes", message="pose.orientation"
    )
    inertia: Array = declare(  # shape (3, 3)
        INERTIA,
        "elements of the inertia tensor about the centre of mass, as in a URDF; only their ratios "
        "matter",
        frame="body axes",
        message="inertia",
    )
    # At capture the end effector is at rest in the body
    grasp_position: Array = declare(
        a_vector(),
        "of the end effector at capture",
        key="grasp.position",
        unit="m",
        frame="in the body's frame",
        message="grasp.position",
    )
    grasp_quaternion_xyzw: Array = declare(
        QUATERNION,
        "end-effector axes to body axes",
        key="grasp.quaternion_xyzw",
        message="grasp.orientation",
    )
    linear_velocity: Array = declare_velocity("linear", "of its centre of mass")
    angular_velocity: Array = declare_velocity("angular", "in inertial axes")
    mass: float = declare(  # zero: not known
        a_number(at_least=0.0),
        "mass of the body, needed for what follows a capture, and for its impulse; then the "
        "inertia must be in kg m2",
        unit="kg",
        brief=True,
        default=0.0,
        message="inertia.m",
    )
    obstacles: tuple[AttachedObstacle, ...] = declare(
        each(part_or_entry("shape", AttachedObstacle, AttachedSphereEntry)),
        "spheres and bodies that move with it, in its frame, which has its origin at the centre of "
        "mass",
        default=(),
        message="obstacles",
    )
    notes: tuple[str, ...] = ()  # for the user: locked joints of its URDF, say

    FACTS = (
        "position",
        "grasp_position",
        "linear_velocity",
        "angular_velocity",
        "mass",
        "obstacles",
    )
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, "target_body", notes=tuple)
        inertia = possible_inertia("target_body.inertia", self.inertia)
        object.__setattr__(self, "inertia", inertia)
        object.__setattr__(self, "obstacles", in_order(self.obstacles))
        self._check_obstacles()

    def _check_obstacles(self) -> None:
        names = set[str]()
        for one in self.obstacles:
            if one.id in names:
                told = "target_body.obstacles"
                raise InvalidInput(Status.OUT_OF_RANGE, told, one.id, "ids must be unique")
            names.add(one.id)
        for sphere in (one for one in self.obstacles if one.is_sphere):
            depth = sphere.radius - float(np.linalg.norm(self.grasp_position - sphere.position))
            if depth >= 0.0:
                raise InvalidInput(
                    Status.OUT_OF_RANGE,
                    "target_body.grasp.position",
                    self.grasp_position.tolist(),
                    f"it must be outside every attached sphere; it is {depth:.4g} m inside "
                    f"{sphere.id}",
                )

    @cached_property
    def _turning(self) -> TorqueFreeMotion:
        to_inertial = pin.Quaternion(self.quaternion_xyzw).toRotationMatrix()
        rate = to_inertial.T @ self.angular_velocity
        return TorqueFreeMotion(self._relative_inertia, self.quaternion_xyzw, rate)

    def _turned(self, times: Array) -> Turning:
        self._require_foretold(float(times.max(initial=0.0)))
        return _turned(self, frozen(times).tobytes())

    def _require_foretold(self, until: float) -> None:
        turns = self.fastest_turn * until
        if not turns <= MOST_TURNS:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "target_body.angular_velocity",
                self.angular_velocity.tolist(),
                f"within {until:.6g} s the body turns too far to be foretold, by "
                f"{turns:.3g} rad; {MOST_TURNS:g} rad are allowed",
            )

    @property
    def _relative_inertia(self) -> Array:
        relative: Array = self.inertia / np.abs(self.inertia).max()
        return relative

    def places(self, points: Array, times: Array) -> Array:
        """Return points of the body in the inertial frame. Shape (times, points, 3) [m].

        Args:
            points: In axes of the body, from its centre of mass. Shape (points, 3) [m].
            times: From the plan's first point on. Shape (times,) [s].
        """
        centers = self.position + times[:, None] * self.linear_velocity
        rotations = self._turned(times).rotations
        places: Array = centers[:, None] + points @ rotations.swapaxes(1, 2)
        return places

    def attitude_series(self, until: float) -> tuple[Array, Array]:
        """Return the Taylor series of its quaternion (x, y, z, w), at least up to a time [s].

        Returns:
            Begin of each, shape (series,) [s], and coefficients, shape (series, orders, 4).
        """
        self._require_foretold(until)
        return self._turning.attitude_series(until)

    def motion(self, point: Array, times: Array) -> PointMotion:
        """Return the motion of a point of the body, and of the body's axes.

        Args:
            point: In axes of the body, from its centre of mass. Shape (3,) [m].
            times: From the plan's first point on. Shape (times,) [s].
        """
        return _motion(self, frozen(point).tobytes(), frozen(times).tobytes())

    def _motion(self, point: Array, times: Array) -> PointMotion:
        """Return `motion`, computed."""
        rotations, rates, accelerations, jerks = self._turned(times)
        # The point's derivatives in body axes: u' as the body sees it, plus w x u.
        first = cross(rates, point)
        turned = cross(accelerations, point)
        second = turned + cross(rates, first)
        seen = cross(jerks, point) + cross(accelerations, first) + cross(rates, turned)
        third = seen + cross(rates, second)
        angular_jerks = jerks + cross(rates, accelerations)

        def inertial(linear: Array, angular: Array) -> Array:
            parts = np.stack([linear, angular], axis=1) @ rotations.swapaxes(1, 2)
            return frozen(parts.reshape(-1, 6))

        moving = np.append(self.linear_velocity, np.zeros(3))
        centers = self.position + times[:, None] * self.linear_velocity
        return PointMotion(
            positions=frozen(centers + rotations @ point),
            rotations=frozen(rotations),
            twists=frozen(inertial(first, rates) + moving),
            accelerations=inertial(second, accelerations),
            jerks=inertial(third, angular_jerks),
        )

    def grasp(self, times: Array) -> PointMotion:
        """Return the motion of the grasp frame, that of an end effector that holds it.

        Args:
            times: From the plan's first point on. Shape (times,) [s].
        """
        motion = self.motion(self.grasp_position, times)
        grasp = pin.Quaternion(self.grasp_quaternion_xyzw).toRotationMatrix()
        return replace(motion, rotations=motion.rotations @ grasp)

    def target(self, time: float) -> Target:
        """Return the target of a capture at a time [s]: the grasp, at rest in the body."""
        grasp = self.grasp(np.array([time]))
        return Target(
            position=grasp.positions[0],
            quaternion_xyzw=eigen_quaternion(grasp.rotations[0]),
            linear_velocity=grasp.twists[0, :3],
            angular_velocity=grasp.twists[0, 3:],
            linear_acceleration=grasp.accelerations[0, :3],
            angular_acceleration=grasp.accelerations[0, 3:],
        )

    @cached_property
    def inertia_at_grasp(self) -> pin.Inertia:
        """Mass and inertia in the frame of an end effector that holds it; mass zero if unknown."""
        to_body = pin.Quaternion(self.grasp_quaternion_xyzw).toRotationMatrix()
        grasp = pin.SE3(to_body, self.grasp_position)
        return grasp.actInv(pin.Inertia(self.mass, np.zeros(3), self.inertia))

    def after(self, time: float) -> TargetBody:
        """Return the body after a time [s]; a negative one is a body that rotates backwards."""
        if time == 0.0:
            return self
        back = math.copysign(1.0, time)
        turning = replace(self, angular_velocity=back * self.angular_velocity)
        motion = turning.motion(np.zeros(3), np.array([abs(time)]))
        return replace(
            self,
            position=self.position + time * self.linear_velocity,
            quaternion_xyzw=eigen_quaternion(motion.rotations[0]),
            angular_velocity=back * motion.twists[0, 3:],
        )

    def seen_from(self, origin: Array, velocity: Array) -> TargetBody:
        """Return the body in another inertial frame with the same axes.

        Args:
            origin: Of that frame, at the plan's first point. Shape (3,) [m].
            velocity: Of that frame. Shape (3,) [m/s].
        """
        place, moves = self.position - origin, self.linear_velocity - velocity
        return replace(self, position=place, linear_velocity=moves)

    @cached_property
    def fastest_turn(self) -> float:
        """Largest angular velocity over all time, but for rounding [rad/s]."""
        to_inertial = pin.Quaternion(self.quaternion_xyzw).toRotationMatrix()
        return fastest_turn(self._relative_inertia, to_inertial, self.angular_velocity)


@lru_cache(maxsize=16)
def _turned(body: TargetBody, times: bytes) -> Turning:
    """Return attitudes at some times: many points of the body are asked for at the same."""
    return body._turning.at(np.frombuffer(times))  # noqa: SLF001


@lru_cache(maxsize=16)
def _motion(body: TargetBody, point: bytes, times: bytes) -> PointMotion:
    """Return `TargetBody.motion`: each step of a search asks for the same times."""
    return body._motion(np.frombuffer(point), np.frombuffer(times))  # noqa: SLF001
