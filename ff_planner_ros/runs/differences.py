"""Differences of two answers to the same request, quantity by quantity."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from ff_planner_msgs.msg import PlanAnswer, PlanMetrics

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.motion.metrics import METRICS
from ff_planner_ros.robot.model import Robot

# On one machine, a plan is the same to the last bit. Another processor has other kernels of linear
# algebra, which round otherwise, and the search amplifies that: measured with the five kernels of
# OpenBLAS for x86 on the paper's capture, up to 1.3e-7 rad and 5e-7 N m. The tolerances are a
# hundred times that, and a hundredth of what the check of a plan allows.
_RAD, _RAD_S, _RAD_S2, _METRE, _METRE_S, _TORQUE = 1e-5, 1e-5, 2e-5, 1e-5, 1e-5, 5e-5
_XI = 1e-5  # coefficients of a polynomial [m/s^6 and so on]
_SECOND = 1e-5  # of a duration that the planner chose; a given duration stays the same
_PEAKS = "metrics.peak_joint_torques"
_ANY = math.inf  # describes the search, not the plan


@dataclass(frozen=True)
class Quantity:
    """Unit and tolerance of a quantity."""

    unit: str
    tolerance: float  # a larger difference counts


QUANTITIES = {
    "time": Quantity("s", _SECOND),
    "joint_positions": Quantity("rad", _RAD),
    "joint_velocities": Quantity("rad/s", _RAD_S),
    "joint_accelerations": Quantity("rad/s2", _RAD_S2),
    "joint_torques": Quantity("N m", _TORQUE),
    "chaser_positions": Quantity("m", _METRE),
    "chaser_quaternions_xyzw": Quantity("rad", _RAD),
    "chaser_linear_velocities": Quantity("m/s", _METRE_S),
    "chaser_angular_velocities": Quantity("rad/s", _RAD_S),
    "ee_positions": Quantity("m", _METRE),
    "ee_quaternions_xyzw": Quantity("rad", _RAD),
    "ee_linear_velocities": Quantity("m/s", _METRE_S),
    "ee_angular_velocities": Quantity("rad/s", _RAD_S),
    "wheel_momenta": Quantity("N m s", _TORQUE),
    "wheel_torques": Quantity("N m", _TORQUE),
    "xi": Quantity("", _XI),
    **{f"metrics.{metric.name}": Quantity(metric.unit, metric.tolerance) for metric in METRICS},
    "solver.starts": Quantity("", _ANY),
    "solver.iterations": Quantity("", _ANY),
    "solver.rollouts": Quantity("", _ANY),
    "solver.optimality": Quantity("", _ANY),
}


@dataclass(frozen=True)
class Difference:
    """A quantity that is not the same to the last bit."""

    quantity: str  # one of `QUANTITIES`
    amount: float  # the largest difference, in its unit; infinite: not comparable
    where: str  # point, joint or entry, in words; may be empty
    unit: str  # that of the quantity, or of the prismatic joint

    @property
    def tolerances(self) -> float:
        """Amount of the difference as a multiple of the tolerance."""
        tolerance = QUANTITIES[self.quantity].tolerance
        if math.isinf(tolerance) or self.amount == 0.0:
            return 0.0
        return self.amount / tolerance if tolerance else math.inf

    @property
    def is_tolerable(self) -> bool:
        """Whether the difference is within the tolerance, so that another processor explains it."""
        return self.tolerances <= 1.0

    def __str__(self) -> str:
        """Return quantity, amount, place and tolerance in words."""
        kind = QUANTITIES[self.quantity]
        words = f"{self.quantity} by {self.amount:.3g} {self.unit}".rstrip()
        place = f" at {self.where}" if self.where else ""
        return f"{words}{place} (tolerance {kind.tolerance:g})"


def differences(
    recorded: PlanAnswer, replayed: PlanAnswer, robot: Robot | None = None
) -> list[Difference]:
    """Return the differences of two answers of the same status; empty: the same to the last bit.

    Times of planning, texts, and metrics that the recorded answer lacks are not compared.

    Args:
        robot: Robot of the plans, for the units of its joints; None: all are revolute.

    Raises:
        ValueError: Arrays of an answer do not fit each other.
    """
    pairs = zip(_values(recorded), _values(replayed), strict=True)
    return [
        found
        for (name, before), (_, now) in pairs
        if (found := _difference(name, before, now, robot)) is not None
    ]


def _values(answer: PlanAnswer) -> Iterator[tuple[str, Array]]:
    """Yield every quantity of an answer; of a refusal, those of its best attempt."""
    if answer.status.code == Status.SOLVED:
        plan = plan_from_answer(answer)
        for item in fields(plan.trajectory):
            yield item.name, getattr(plan.trajectory, item.name)
        wheels, none = plan.wheels, np.empty((len(plan.trajectory.time), 0))
        yield "wheel_momenta", none if wheels is None else wheels.momenta
        yield "wheel_torques", none if wheels is None else wheels.torques
        yield "xi", plan.xi
    for name in QUANTITIES:
        group, _, field = name.partition(".")
        if field:
            part = (answer.metrics or [PlanMetrics()])[0] if group == "metrics" else answer.solver
            yield name, np.array(getattr(part, field), dtype=float)


def _difference(name: str, before: Array, now: Array, robot: Robot | None) -> Difference | None:
    if name.startswith("metrics.") and np.isnan(before).all() and before.size:
        return None  # it was not recorded
    if before.shape != now.shape:
        shapes = f"shapes {_shape(before)} before and {_shape(now)} now"
        return Difference(name, math.inf, shapes, QUANTITIES[name].unit)
    if before.tobytes() == now.tobytes():
        return None
    apart = _angles(before, now) if name.endswith("quaternions_xyzw") else np.abs(now - before)
    # Infinite in both, or a zero of another sign.
    apart = np.where(before == now, 0.0, apart) if apart.shape == before.shape else apart
    apart = np.nan_to_num(apart, nan=math.inf, posinf=math.inf)
    place = np.unravel_index(int(apart.argmax()), apart.shape)
    return Difference(name, float(apart[place]), _words(name, place), _unit(name, place, robot))


def _unit(name: str, place: tuple[np.intp, ...], robot: Robot | None) -> str:
    unit = QUANTITIES[name].unit
    of_joint = name.startswith("joint_") or name == _PEAKS
    if robot is None or not of_joint or not robot.slides(int(place[-1])):
        return unit
    return "N" if unit == "N m" else unit.replace("rad", "m")


def _angles(before: Array, now: Array) -> Array:
    """Return the angle between two attitudes at each point [rad], exact for small angles, too."""
    away = np.minimum(
        np.linalg.norm(now - before, axis=1), np.linalg.norm(now + before, axis=1)
    ).clip(max=2.0)
    angles: Array = 4.0 * np.arcsin(away / 2.0)
    return angles


def _words(name: str, place: tuple[np.intp, ...]) -> str:
    if name.startswith("joint_") and len(place) == 2:
        return f"point {place[0]}, joint {place[1] + 1}"
    if name.startswith("wheel_") and len(place) == 2:
        return f"point {place[0]}, wheel {place[1] + 1}"
    if place and name not in ("xi", _PEAKS):
        return f"point {place[0]}"
    return f"entry {place[0]}" if place else ""


def _shape(array: Array) -> str:
    return " x ".join(map(str, array.shape)) or "1"
