"""What is asked of the planner."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

import numpy as np

from ff_planner_ros.arrays import Array, finite_number, finite_vector, unit_quaternion
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

# Five points hold a plan's start, end and middle; above ten thousand the answer no longer
# fits a service response that a mission executive would want to read.
MIN_POINTS, MAX_POINTS = 5, 10_000


def _zeros() -> Array:
    return np.zeros(3)


class Orientation(enum.StrEnum):
    """What a target says about the end effector's orientation."""

    FIXED = "fixed"
    FREE = "free"
    ABOUT_AXIS = "about_axis"  # free to turn about one axis of the end effector


@dataclass(frozen=True, eq=False)
class Target:
    """What the end effector shall do at the end of the plan, in the inertial frame.

    Raises:
        InvalidInput: Wrong size, not finite, or a quaternion not of unit length.
    """

    position: Array  # shape (3,) [m]
    quaternion_xyzw: Array  # shape (4,), end effector to inertial, unit length
    linear_velocity: Array = field(default_factory=_zeros)  # shape (3,) [m/s]
    angular_velocity: Array = field(default_factory=_zeros)  # shape (3,) [rad/s]
    linear_acceleration: Array = field(default_factory=_zeros)  # shape (3,) [m/s2]
    angular_acceleration: Array = field(default_factory=_zeros)  # shape (3,) [rad/s2]
    orientation: Orientation = Orientation.FIXED
    free_axis_in_ee: Array | None = None  # unit length where orientation is ABOUT_AXIS, else None

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        for name in self.__dataclass_fields__:
            if name in ("orientation", "free_axis_in_ee"):
                continue
            if name == "quaternion_xyzw":
                checked = unit_quaternion("target.quaternion_xyzw", self.quaternion_xyzw)
            else:
                checked = finite_vector(f"target.{name}", getattr(self, name), 3)
            object.__setattr__(self, name, checked)


@dataclass(frozen=True, eq=False)
class Sphere:
    """An obstacle, at rest or in uniform motion: a sphere that the arm's centre lines stay out of.

    Raises:
        InvalidInput: Wrong size, not finite, or a radius that is not positive.
    """

    id: str  # name in messages
    center: Array  # at the plan's first point, in the inertial frame; shape (3,) [m]
    radius: float  # greater than zero [m]
    velocity: Array = field(default_factory=_zeros)  # constant, likewise; shape (3,) [m/s]

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        name = f"obstacles[{self.id}]"
        for part in ("center", "velocity"):
            checked = finite_vector(f"{name}.{part}", getattr(self, part), 3)
            object.__setattr__(self, part, checked)
        object.__setattr__(self, "radius", finite_number(f"{name}.radius", self.radius, above=0.0))


@dataclass(frozen=True)
class Objective:
    """Weights of Eq. (44), joint path length, and Eq. (45), chaser attitude.

    Raises:
        InvalidInput: Not finite, negative, or both zero.
    """

    joint_path_length: float
    chaser_attitude: float

    def __post_init__(self) -> None:
        """Check both weights."""
        for name in ("joint_path_length", "chaser_attitude"):
            weight = finite_number(f"objective.{name}", getattr(self, name))
            if weight < 0.0:
                raise InvalidInput(
                    Status.OUT_OF_RANGE, f"objective.{name}", weight, "it must not be negative"
                )
        if self.joint_path_length == self.chaser_attitude == 0.0:
            raise InvalidInput(
                Status.OUT_OF_RANGE, "objective", "all zero", "one weight must be positive"
            )


@dataclass(frozen=True)
class Limits:
    """What to keep beside the joints' position limits, which are always kept.

    Raises:
        InvalidInput: An angle that is not positive.
    """

    joint_velocities: bool = False  # whether to keep the velocity limits of the URDF
    chaser_attitude: float = math.inf  # largest Euler angle, Eq. (45) [rad]; infinite: any

    def __post_init__(self) -> None:
        """Check the angle."""
        if not self.chaser_attitude > 0.0:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "limits.chaser_attitude",
                self.chaser_attitude,
                "it must be greater than 0 rad, or none",
            )


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """What is asked of the planner: a motion from a start state to a target.

    Raises:
        InvalidInput: A duration that is not positive, a number of points out of range, or a
            state whose number of joints is not the robot's.
    """

    robot: Robot
    start: SystemState  # state at the first point of the plan
    target: Target  # end effector at the last point of the plan
    duration: float  # time between the two, greater than zero [s]
    points: int  # number of points of the plan, n_p in the paper
    obstacles: tuple[Sphere, ...]
    objective: Objective
    limits: Limits = Limits()  # what to keep beside the joints' position limits

    def __post_init__(self) -> None:
        """Check what the parts cannot check by themselves."""
        object.__setattr__(self, "duration", finite_number("duration", self.duration, above=0.0))
        if not MIN_POINTS <= self.points <= MAX_POINTS:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "points",
                self.points,
                f"it must be from {MIN_POINTS} to {MAX_POINTS}",
            )
        finite_vector("joints.position", self.start.joint_positions, self.robot.joints)
