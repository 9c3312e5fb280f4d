"""Differences of a recorded answer and a new one to the same task, field by field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.shown import shown
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.messages.status import status_fields
from ff_planner_ros.messages.trajectories import poses_in, trajectory_in
from ff_planner_ros.messages.wheels import wheels_in
from ff_planner_ros.planning.motion.metrics import METRICS
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import bodies_of, whole
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
    "target_positions": Quantity("m", _METRE),
    "target_quaternions_xyzw": Quantity("rad", _RAD),
    "first_guess": Quantity("", 0.0),
    "duration": Quantity("s", _SECOND),
    "effort": Quantity("", 0.0),
    "plans": Quantity("", 0.0),
    "family": Quantity("", 0.0),
    "orientation_reading": Quantity("", 0.0),
    "status.retry": Quantity("", 0.0),
    # Words, which hold numbers
    **{f"status.{name}": Quantity("", _ANY) for name in ("message", "field", "value", "allowed")},
    **{f"solver.{item.name}": Quantity("", _ANY) for item in fields(SolverReport)},
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
    recorded: Any, task: PlanningTask, again: Plan | FfPlannerError
) -> list[Difference]:
    """Return the differences of a recorded answer and a new one; empty: the same to the last bit.

    Times of planning, stamps and metrics that the recorded answer lacks are not compared.

    Args:
        recorded: The answer, from ROS or as it was decoded.

    Raises:
        ValueError: Arrays of the answer do not fit each other.
        AttributeError: The answer lacks a field.
    """
    plans = again if isinstance(again, Plan) else getattr(again, "found", None)
    phases = plans.phases if isinstance(plans, Plan) else ()
    found = [
        one
        for name, before, now in _of_answer(recorded, task, again)
        if (one := _difference(name, before, now, task.problem.robot)) is not None
    ]
    if len(recorded.plans) != len(phases):
        counts = f"{len(recorded.plans)} plans before and {len(phases)} now"
        return [*found, Difference("plans", math.inf, counts, "")]
    bodies = bodies_of(task, plans) if isinstance(plans, Plan) else []
    for number, (message, plan, body) in enumerate(
        zip(recorded.plans, phases, bodies, strict=True)
    ):
        for name, before, now in _of_plan(message, plan, body):
            one = _difference(name, before, now, task.problem.robot)
            if one is not None:
                place = f"phase {number + 1}, {one.where}" if len(phases) > 1 else one.where
                found.append(replace(one, where=place))
    return found


def is_cut(task: PlanningTask) -> bool:
    """Return whether a clock had ended the search of a phase, at a step that is known."""
    return bool(task.effort or any(phase.effort for phase in task.then))


def _of_answer(
    recorded: Any, task: PlanningTask, again: Plan | FfPlannerError
) -> Iterator[tuple[str, Any, Any]]:
    """Yield name and both values of what an answer holds beside its plans."""
    total: Plan | None
    if isinstance(again, Plan):
        total = whole(again)
        status: dict[str, Any] = {"message": total.message}
    else:
        attempt, status = getattr(again, "attempt", None), status_fields(again)
        total = attempt if isinstance(attempt, Plan) else None
    # A search that a clock had ended ends at a step now, and says so.
    cut = is_cut(task)
    for name, now in status.items():
        if name == "retry" or (name != "code" and not cut):
            yield f"status.{name}", getattr(recorded.status, name), now
    guess = np.empty(0) if task.first_guess is None else task.first_guess
    yield "first_guess", np.array(recorded.inputs.first_guess), guess
    if total is None or not recorded.metrics:
        return
    (metrics,) = recorded.metrics
    for metric in METRICS:
        before, now = getattr(metrics, metric.name, math.nan), getattr(total.metrics, metric.name)
        yield f"metrics.{metric.name}", before, now
    for item in fields(SolverReport):
        before, now = (getattr(one, item.name) for one in (recorded.solver, total.solver))
        if not (cut and isinstance(now, str)):
            yield f"solver.{item.name}", before, now


def _of_plan(message: Any, plan: Plan, body: TargetBody | None) -> Iterator[tuple[str, Any, Any]]:
    """Yield name and both values of what the message of one phase's plan holds."""
    motion, again = trajectory_in(message), plan.trajectory
    stamps = np.rint(again.time * NANOSECONDS) / NANOSECONDS
    again = replace(again, time=stamps)
    for item in fields(motion):
        yield item.name, getattr(motion, item.name), getattr(again, item.name)
    none = np.empty((len(again.time), 0))
    both = wheels_in(message), plan.wheels
    for name in ("momenta", "torques"):
        then, now = (none if one is None else getattr(one, name) for one in both)
        yield f"wheel_{name}", then, now
    target, there = poses_in(message.target_path, len(message.target_path.poses)), np.empty((0, 7))
    if body is not None:
        along = CapturedBody(body).along(plan.trajectory)
        there = np.hstack((along.positions, along.quaternions_xyzw))
    yield "target_positions", target[:, :3], there[:, :3]
    yield "target_quaternions_xyzw", target[:, 3:], there[:, 3:]
    yield "xi", np.array(message.xi), plan.xi
    for name in ("family", "orientation_reading", "duration", "effort"):
        yield name, getattr(message, name), getattr(plan, name) or type(getattr(message, name))()


def _difference(name: str, then: Any, again: Any, robot: Robot) -> Difference | None:
    if isinstance(then, str):
        words = f"{shown(then)} before, {shown(again)} now"
        return None if then == again else Difference(name, math.inf, words, "")
    before, now = np.array(then, dtype=float), np.array(again, dtype=float)
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


def _unit(name: str, place: tuple[np.intp, ...], robot: Robot) -> str:
    unit = QUANTITIES[name].unit
    of_joint = name.startswith("joint_") or name == _PEAKS
    if not of_joint or not robot.slides(int(place[-1])):
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
