"""Limits of a plan, beside the joints' position limits, which always hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

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
    chaser_attitude: float = declare(  # infinite: any
        or_none(a_number(above=0.0, at_least=_LEAST), math.inf),
        "largest Euler angle of the chaser, Eq. (45)",
        unit="rad",
        default=math.inf,
        message="chaser_attitude[0]",
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
    chaser_rotation: float = declare(  # infinite: any
        or_none(a_number(above=0.0, at_least=_LEAST), math.inf),
        "largest rotation angle of the chaser since the plan's first point, the same in any frame; "
        "mostly more than its largest Euler angle",
        unit="rad",
        default=math.inf,
        message="chaser_rotation[0]",
        brief=True,
    )
    grasp_force: float = declare(  # infinite: any
        or_none(a_number(above=0.0, at_least=_LEAST), math.inf),
        "largest force through the grasp of a payload",
        unit="N",
        default=math.inf,
        message="grasp_force[0]",
        brief=True,
    )
    grasp_torque: float = declare(  # infinite: any
        or_none(a_number(above=0.0, at_least=_LEAST), math.inf),
        "largest torque through the grasp of a payload, about the end effector or the link's frame",
        unit="N m",
        default=math.inf,
        message="grasp_torque[0]",
        brief=True,
    )
    capture_impulse: float = declare(  # infinite: any
        or_none(a_number(above=0.0, at_least=_LEAST), math.inf),
        "largest impulse on a captured body, from its motion relative to the end effector at "
        "contact",
        unit="N s",
        default=math.inf,
        message="capture_impulse[0]",
        brief=True,
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
