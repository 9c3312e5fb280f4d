"""The metrics of a plan: each is declared once, with unit, label and tolerance of replay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

import numpy as np

from ff_planner_ros.common.shown import in_a_line

# On one machine, a plan is reproduced to the last bit. Another processor has other kernels of
# linear algebra, which round differently. These differences are tolerated between two machines;
# `runs/differences.py` says how they were found.
_RAD, _RAD_S, _RAD_S2, _METRE, _TORQUE, _ONE = 1e-5, 1e-5, 2e-5, 1e-5, 5e-5, 1e-5

_UNITS = {"mm": 1e3} | dict.fromkeys(("deg", "deg/s", "deg/s2"), 180.0 / np.pi)
# What is missing if a metric is infinite; by default obstacles.
_WITHOUT = {
    "max_view_angle": "no camera",
    **dict.fromkeys(("peak_grasp_force", "peak_grasp_torque"), "no payload"),
    **dict.fromkeys(("capture_impulse", "capture_angular_impulse"), "no mass"),
    "max_path_position_error": "no path",
    "max_path_orientation_error": "free",
    "min_self_clearance": "no pairs",
    "min_velocity_margin": "no limits",
    "min_acceleration_margin": "no limits",
    "min_torque_margin": "no limits",
}


@dataclass(frozen=True)
class Metric:
    """How one metric is named, written and compared."""

    name: str  # field of `Metrics`, of `PlanMetrics.msg` and of the JSON file
    unit: str  # SI unit of the value; empty where it has none
    label: str  # name in tables
    tolerance: float  # largest difference between two machines, in `unit`
    shown_unit: str  # unit in tables
    digits: str  # format of the value in tables, as of `format`

    def shown(self, value: float | Sequence[float]) -> str:
        """Return the value for a table, without its unit; of several values the largest."""
        if np.isnan(value).any() or np.size(value) == 0:
            return "none"  # not known
        if np.isinf(value).any():
            return _WITHOUT.get(self.name, "no obstacles")
        return format(self.in_shown_unit(value), self.digits)

    def in_shown_unit(self, value: float | Sequence[float]) -> float:
        """Return the value in the unit of tables; of several values the largest."""
        return float(np.max(value) * _UNITS.get(self.shown_unit, 1.0))

    def text(self, value: float | Sequence[float]) -> str:
        """Return the value in words, with its unit."""
        unit = self.shown_unit if np.isfinite(value).all() else ""
        return f"{self.shown(value)} {unit}".rstrip()


def _metric(
    unit: str,
    label: str,
    tolerance: float,
    shown_unit: str,
    digits: str,
    default: Any = MISSING,
    kw_only: bool = False,
) -> Any:
    said = {"metric": (unit, label, tolerance, shown_unit, digits)}
    return field(default=default, metadata=said, kw_only=kw_only)


@dataclass(frozen=True)
class Metrics:
    """The metrics of a plan, computed by the check after the solve.

    The objectives, Eqs. (44) and (45), and the final errors are those at the goal. All others
    include the post-goal segment. In margins, jump and joint path, a prismatic joint's position,
    velocity and acceleration are multiplied by its weight [rad/m], and its force is divided by it.
    """

    joint_path_length: float = _metric("rad", "joint path length", 10 * _RAD, "rad", ".4f")
    max_chaser_euler: float = _metric("rad", "largest chaser Euler angle", _RAD, "deg", ".2f")
    # Of the chaser since the first point, at any time; NaN: not known.
    max_chaser_rotation: float = _metric(
        "rad", "largest chaser rotation", _RAD, "deg", ".2f", np.nan, kw_only=True
    )
    # Of the chaser at the goal since the first point; NaN: not known.
    final_chaser_rotation: float = _metric(
        "rad", "chaser rotation at the goal", _RAD, "deg", ".4f", np.nan, kw_only=True
    )
    # Of the goal off the camera's axis, while the goal must be in view; infinite: no camera.
    max_view_angle: float = _metric(
        "rad", "largest angle off the camera's axis", _RAD, "deg", ".2f", np.inf, kw_only=True
    )
    # Of any body, or link line, from any sphere, between the points too; infinite: no obstacles.
    min_clearance: float = _metric("m", "clearance", _METRE, "mm", ".1f")
    # At any time: between two points the joints are on the quintics through them.
    min_joint_margin: float = _metric("rad", "margin to joint limits", _RAD, "deg", ".1f")
    # To the URDF's limits, at any time; may be negative where the problem does not limit rates.
    min_velocity_margin: float = _metric(
        "rad/s", "margin to velocity limits", _RAD_S, "deg/s", ".2f"
    )
    # Largest absolute torque of each joint at any time, exact to 5e-4; of a prismatic one force [N]
    peak_joint_torques: tuple[float, ...] = _metric(
        "N m", "peak joint torque", _TORQUE, "N m", ".4g"
    )
    # Largest difference between the torques and those of the joint accelerations.
    torque_error: float = _metric("N m", "torque error", _TORQUE, "N m", ".1e")
    # R_obst of Eqs. (46) and (47); zero for a plan without collision.
    penalty: float = _metric("", "penalty", _ONE, "", ".3g")
    # Of the plan's last point, or of the motion that follows from its points: the larger one.
    final_position_error: float = _metric("m", "final position error", _METRE, "mm", ".4f")
    final_orientation_error: float = _metric("rad", "final orientation error", _RAD, "deg", ".5f")
    momentum_error: float = _metric("", "momentum error", _ONE, "relative", ".1e")
    # Of the generalised Jacobian J_D at the points; zero in a dynamic singularity.
    min_singular_value: float = _metric("", "smallest singular value", _ONE, "", ".3g")
    # From the start state's joint velocities to the plan's first: methods without null-space motion
    # jump
    start_velocity_jump: float = _metric("rad/s", "jump of joint rates", _RAD_S, "deg/s", ".2f")
    # Of any body from any other that can move relative to it, at any time; infinite: no bodies.
    min_self_clearance: float = _metric("m", "self-clearance", _METRE, "mm", ".1f", np.inf)
    # To the problem's limits, at any time; infinite: it has none.
    min_acceleration_margin: float = _metric(
        "rad/s2", "margin to acceleration limits", _RAD_S2, "deg/s2", ".2f", np.inf
    )
    # To the URDF's limits, at any time; infinite: it has none, NaN: not known. May be negative,
    # where the problem does not limit torques.
    min_torque_margin: float = _metric(
        "N m", "margin to effort limits", _TORQUE, "N m", ".4g", np.nan
    )
    # Largest absolute momentum and torque of each wheel at any time; empty: there are none.
    peak_wheel_momenta: tuple[float, ...] = _metric(
        "N m s", "peak wheel momentum", _TORQUE, "N m s", ".4g", ()
    )
    peak_wheel_torques: tuple[float, ...] = _metric(
        "N m", "peak wheel torque", _TORQUE, "N m", ".4g", ()
    )
    # Through the grasp of a payload at any time, exact to 5e-4; infinite: it holds none.
    peak_grasp_force: float = _metric("N", "peak grasp force", _TORQUE, "N", ".4g", np.inf)
    peak_grasp_torque: float = _metric("N m", "peak grasp torque", _TORQUE, "N m", ".4g", np.inf)
    # Largest on a body that is captured, within the tolerances of the grasp; infinite: none is, or
    # its mass is not known.
    capture_impulse: float = _metric("N s", "capture impulse", _TORQUE, "N s", ".4g", np.inf)
    capture_angular_impulse: float = _metric(
        "N m s", "capture angular impulse", _TORQUE, "N m s", ".4g", np.inf
    )
    # From the path to follow, at any time up to the goal; infinite: no path, or a free orientation.
    max_path_position_error: float = _metric(
        "m", "largest distance from the path", _METRE, "mm", ".4f", np.inf
    )
    max_path_orientation_error: float = _metric(
        "rad", "largest angle to the path", _RAD, "deg", ".5f", np.inf
    )
    # Pairs of the clearances, `body/obstacle` and `body/body`, and their times [s]; empty and
    # infinite: there is none.
    min_clearance_pair: str = ""
    min_clearance_time: float = np.inf
    min_self_clearance_pair: str = ""
    min_self_clearance_time: float = np.inf

    FACTS = (
        "joint_path_length",
        "max_chaser_rotation",
        "min_clearance",
        "min_self_clearance",
        "min_torque_margin",
    )
    __repr__ = in_a_line

    def told(self, name: str) -> str:
        """Return a metric in words with its unit; a clearance with its pair and time."""
        text = METRIC_BY_NAME[name].text(getattr(self, name))
        pair = getattr(self, f"{name}_pair", "")
        return f"{text}, {pair} at {getattr(self, f'{name}_time'):.2f} s" if pair else text


METRICS = tuple(
    Metric(item.name, *item.metadata["metric"])
    for item in fields(Metrics)
    if "metric" in item.metadata
)
METRIC_BY_NAME = {metric.name: metric for metric in METRICS}
