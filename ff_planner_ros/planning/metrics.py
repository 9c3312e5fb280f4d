"""What a plan is worth: each metric once, with its unit, its words and what replay tolerates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

# On one machine, a plan comes out the same to the last bit. Another processor has other kernels of
# linear algebra, which round differently. These differences are tolerated between two machines;
# how they were found stands in `runs/differences.py`.
_RAD, _RAD_S, _METRE, _TORQUE, _ONE = 1e-5, 1e-5, 1e-5, 5e-5, 1e-5

_UNITS = {"mm": 1e3, "deg": 180.0 / np.pi, "deg/s": 180.0 / np.pi}


@dataclass(frozen=True)
class Metric:
    """How one metric is named, written and compared.

    Attributes:
        name: Field of `Metrics`, of `PlanMetrics.msg` and of the JSON file.
        unit: SI unit of the value; empty where it has none.
        label: Name in tables.
        tolerance: Largest difference between two machines, in `unit`.
        shown_unit: Unit in tables.
        digits: Format of the value in tables, as of `format`.
    """

    name: str
    unit: str
    label: str
    tolerance: float
    shown_unit: str
    digits: str

    def shown(self, value: float | Sequence[float]) -> str:
        """Return the value for a table, without its unit; of several values the largest."""
        return format(np.max(value) * _UNITS.get(self.shown_unit, 1.0), self.digits)

    def text(self, value: float | Sequence[float]) -> str:
        """Return the value in words, with its unit; `none` where it is infinite."""
        if not np.isfinite(np.max(value)):
            return "none"
        return f"{self.shown(value)} {self.shown_unit}".rstrip()


def _metric(unit: str, label: str, tolerance: float, shown_unit: str, digits: str) -> Any:
    return field(metadata={"metric": (unit, label, tolerance, shown_unit, digits)})


@dataclass(frozen=True)
class Metrics:
    """What the plan is worth, computed by the check after the solve.

    The objectives and the final errors are those at the goal. All others hold for the tail, too.

    Attributes:
        joint_path_length: Eq. (44) [rad].
        max_chaser_euler: Eq. (45) [rad].
        min_clearance: Of any link line from any sphere, certified between the points too [m];
            infinite without obstacles.
        min_joint_margin: To the nearest joint limit [rad].
        min_velocity_margin: Of any joint rate to its limit in the URDF, at the points [rad/s];
            negative beyond it, which only a problem that limits the rates forbids.
        peak_joint_torques: Largest absolute torque of each joint at the points [N m]; between them
            nothing is certified.
        torque_error: Largest difference of the plan's torques to those that its joint accelerations
            need while nothing pushes the chaser [N m].
        penalty: R_obst of Eqs. (46) and (47); zero for a collision-free plan.
        final_position_error: Of the end effector against the target [m].
        final_orientation_error: Of the end effector against the target [rad].
        momentum_error: Largest change of the total momentum along the plan, relative.
        min_singular_value: Smallest singular value of the generalised Jacobian J_D at the points;
            zero in a dynamic singularity.
        start_velocity_jump: Largest difference between the plan's first joint rates and the
            start state's [rad/s]. Eq. (31) has no null-space motion: the joint rates jump where
            the start has some.
    """

    joint_path_length: float = _metric("rad", "joint path length", 10 * _RAD, "rad", ".4f")
    max_chaser_euler: float = _metric("rad", "largest chaser attitude", _RAD, "deg", ".2f")
    min_clearance: float = _metric("m", "clearance", _METRE, "mm", ".1f")
    min_joint_margin: float = _metric("rad", "margin to joint limits", _RAD, "deg", ".1f")
    min_velocity_margin: float = _metric(
        "rad/s", "margin to velocity limits", _RAD_S, "deg/s", ".2f"
    )
    peak_joint_torques: tuple[float, ...] = _metric(
        "N m", "peak joint torque", _TORQUE, "N m", ".4g"
    )
    torque_error: float = _metric("N m", "torque error", _TORQUE, "N m", ".1e")
    penalty: float = _metric("", "penalty", _ONE, "", ".3g")
    final_position_error: float = _metric("m", "final position error", _METRE, "mm", ".4f")
    final_orientation_error: float = _metric("rad", "final orientation error", _RAD, "deg", ".5f")
    momentum_error: float = _metric("", "momentum error", _ONE, "relative", ".1e")
    min_singular_value: float = _metric("", "smallest singular value", _ONE, "", ".3g")
    start_velocity_jump: float = _metric("rad/s", "jump of joint rates", _RAD_S, "deg/s", ".2f")


METRICS = tuple(Metric(item.name, *item.metadata["metric"]) for item in fields(Metrics))
