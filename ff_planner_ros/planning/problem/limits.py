"""Limits of a plan, beside the joints' position limits, which always hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ff_planner_ros.common.arrays import finite_vector
from ff_planner_ros.common.declared import DeclaredField, check_declared, declare
from ff_planner_ros.common.forms import (
    ALWAYS_FROM_URDF,
    FROM_URDF,
    ONE_OR_EACH,
    a_number,
    or_none,
)

# No limit is less [rad, N, N m, N s]: the check of a plan could not resolve it.
_LEAST = 1e-6
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
