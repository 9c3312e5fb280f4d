"""Limits of a plan, beside the joints' position limits, which always hold, and of its end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.common.declared import DeclaredField, check_declared, declare
from ff_planner_ros.common.forms import (
    ALWAYS_FROM_URDF,
    FROM_URDF,
    ONE_OR_EACH,
    QUATERNION,
    a_number,
    or_none,
)
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.quaternion import (
    angle_of_quaternion,
    quaternion_inverse,
    quaternion_product,
)

# No limit is less [rad, N, N m, N s]: the check of a plan could not resolve it.
_LEAST = 1e-6
# No angle is less [rad]: the search keeps a fiftieth of it free.
_LEAST_AT_GOAL = 1e-5
# Default tolerance [rad], that of the end effector's orientation.
_USUAL_TOLERANCE = 1e-3
# Limits of one number each, infinite where there is none.
OF_ONE_NUMBER = (
    *("chaser_attitude", "chaser_rotation"),
    *("grasp_force", "grasp_torque", "capture_impulse"),
)


def _at_most(message: str, sentence: str, unit: str, brief: bool = True) -> Any:
    """Declare a limit of one number; infinite: any."""
    form = or_none(a_number(above=0.0, at_least=_LEAST), math.inf)
    return declare(
        form, sentence, unit=unit, default=math.inf, message=f"{message}[0]", brief=brief
    )


@dataclass(frozen=True)
class Limits:
    """Limits beside the joints' position limits, which always hold.

    Raises:
        InvalidInput: A limit that is not positive, or below 1e-6 unless of accelerations.
    """

    FIRST: ClassVar[Sequence[str]] = ("position", "velocity", "acceleration", "effort")
    BESIDE: ClassVar[Mapping[str, DeclaredField]] = {
        "position": DeclaredField(
            ALWAYS_FROM_URDF, "joint positions are always kept", optional=True, default=True
        )
    }

    joint_velocities: bool = declare(
        FROM_URDF,
        "joint velocity limits",
        key="velocity",
        default=False,
    )
    chaser_attitude: float = _at_most(
        "chaser_attitude", "largest Euler angle of the chaser, Eq. (45)", "rad", brief=False
    )
    joint_accelerations: tuple[float, ...] | None = declare(  # None: any
        or_none(ONE_OR_EACH),
        "largest joint acceleration either way, one for each joint or one for all",
        key="acceleration",
        unit="rad/s2",
        default=None,
        message="accelerations",
    )
    joint_torques: bool = declare(
        FROM_URDF,
        "joint torque limits",
        key="effort",
        default=True,
    )
    chaser_rotation: float = _at_most(
        "chaser_rotation",
        "largest rotation angle of the chaser since the plan's first point, the same in any frame; "
        "mostly more than its largest Euler angle",
        "rad",
    )
    grasp_force: float = _at_most(
        "grasp_force", "largest force through the grasp of a payload", "N"
    )
    grasp_torque: float = _at_most(
        "grasp_torque",
        "largest torque through the grasp of a payload, about the end effector or the link's frame",
        "N m",
    )
    capture_impulse: float = _at_most(
        "capture_impulse",
        "largest impulse on a captured body, from its motion relative to the end effector at "
        "contact",
        "N s",
    )

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "limits")

    def of_joints(self, count: int) -> Limits:
        """Return the limits with one acceleration limit for each of so many joints.

        Raises:
            InvalidInput: There are acceleration limits for another number of joints.
        """
        limits = self.joint_accelerations
        if limits is None:
            return self
        if len(limits) == 1:
            limits *= count
        finite_vector("limits.acceleration", limits, count)
        return replace(self, joint_accelerations=limits)


@dataclass(frozen=True, eq=False)
class ChaserGoal:
    """The chaser's attitude at the goal: near that at the start, near a given one, or any.

    Raises:
        InvalidInput: Both are given, a tolerance without an attitude, an angle below 1e-5 rad, or
            a quaternion not of unit length.
    """

    rotation: float | None = declare(
        a_number(above=0.0, at_least=_LEAST_AT_GOAL),
        "largest rotation angle of the chaser at the goal since the plan's first point, beside any "
        "goal, target_body too",
        key="target.chaser_rotation",
        unit="rad",
        default=None,
        message="goal.chaser_rotation[0]",
    )
    quaternion_xyzw: Array | None = declare(
        QUATERNION,
        "likewise: attitude of the chaser at the goal, chaser axes to inertial axes",
        key="target.chaser_quaternion_xyzw",
        default=None,
        message="goal.chaser_attitude[0]",
    )
    tolerance: float | None = declare(
        a_number(above=0.0, at_least=_LEAST_AT_GOAL),
        f"largest angle from chaser_quaternion_xyzw at the goal; default {_USUAL_TOLERANCE:g}",
        key="target.chaser_tolerance",
        unit="rad",
        default=None,
        message="limits.chaser_tolerance[0]",
    )

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check what the parts cannot check by themselves."""
        check_declared(self, "")
        field, given = "target.chaser_quaternion_xyzw", self.quaternion_xyzw
        if given is not None and self.rotation is not None:
            allowed = "with chaser_rotation it must be left out: give one of both"
            raise InvalidInput(Status.OUT_OF_RANGE, field, given.tolist(), allowed)
        if given is None and self.tolerance is not None:
            field, allowed = "target.chaser_tolerance", "it needs chaser_quaternion_xyzw"
            raise InvalidInput(Status.OUT_OF_RANGE, field, self.tolerance, allowed)
        if given is not None and self.tolerance is None:
            object.__setattr__(self, "tolerance", _USUAL_TOLERANCE)

    @property
    def most(self) -> float:
        """Largest angle off the attitude that is asked for [rad]; infinite: any."""
        if self.quaternion_xyzw is not None and self.tolerance is not None:
            return self.tolerance
        return math.inf if self.rotation is None else self.rotation

    def wanted(self, at_start: Array) -> Array:
        """Return the attitude that is asked for, given that at the start, as quaternions (4,)."""
        return at_start if self.quaternion_xyzw is None else self.quaternion_xyzw

    def off(self, at_start: Array, at_goal: Array) -> float:
        """Return the angle between the attitude at the goal and the one asked for [rad].

        Args:
            at_start: Quaternion, chaser axes to inertial axes. Shape (4,).
            at_goal: Likewise.
        """
        to_wanted = quaternion_inverse(self.wanted(at_start))
        return float(angle_of_quaternion(quaternion_product(to_wanted, at_goal)))


ANY_ATTITUDE = ChaserGoal()
