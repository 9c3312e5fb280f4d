"""A plan in words: what the command line prints of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.declared import declared_by_name
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME, Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import ChaserGoal, Limits
from ff_planner_ros.robot.model import Robot

# Of the metrics, what a user wants to know first.
_TOLD = (
    *("joint_path_length", "max_chaser_euler", "max_chaser_rotation"),
    *("min_clearance", "min_self_clearance"),
    *("min_joint_margin", "min_velocity_margin", "min_acceleration_margin", "min_torque_margin"),
    *("peak_joint_torques", "final_position_error", "final_orientation_error", "momentum_error"),
)

# Finite only with a payload, a body that is captured, or a path to follow.
_OF_GRASP = (
    *("peak_grasp_force", "peak_grasp_torque"),
    *("capture_impulse", "capture_angular_impulse"),
)
_OF_PATH = ("max_path_position_error", "max_path_orientation_error")


def plan_rows(
    robot: Robot | None,
    plan: Plan,
    solve_time: float,
    digest: str,
    chosen: bool,
    limits: Limits | None,
    attains: bool,
) -> list[tuple[str, str]]:
    """Return name and value of what a user wants to know first of a plan made in `solve_time` s.

    Args:
        robot: Says which joints are prismatic; None: not known.
        digest: Digest of the task.
        chosen: Whether the planner chose the duration.
        limits: Limits that the plan keeps; None: not known.
        attains: Whether an attitude of the chaser at the goal was asked for.
    """
    solver, metrics = plan.solver, plan.metrics
    told = {name: metrics.told(name) for name in _TOLD}
    if attains:
        told["final_chaser_rotation"] = metrics.told("final_chaser_rotation")
    told["peak_joint_torques"] = _peaks(robot, plan)
    return [
        ("status", Status.SOLVED.name.lower()),
        *([("duration", f"{plan.duration:.3f} s, chosen")] if chosen and plan.duration else []),
        *([] if limits is None else [("limits kept", _limits(limits, plan))]),
        *((METRIC_BY_NAME[name].label, text) for name, text in told.items()),
        *_wheel_rows(metrics),
        *_finite_rows(metrics),
        *([] if plan.robust is None else [("robust", plan.robust.told(metrics.joint_path_length))]),
        *([("parametrisation", plan.family)] if plan.family else []),
        *_at_rest(plan),
        *(("note", note) for note in plan.notes),
        ("solver", solver.stop_reason),
        ("optimality", f"{solver.optimality:.1e}" if np.isfinite(solver.optimality) else "none"),
        ("search", f"{solver.starts} starts, {solver.rollouts} rollouts, {solve_time:.2f} s"),
        ("digest of the task", digest),
    ]


def _peaks(robot: Robot | None, plan: Plan) -> str:
    """Return the largest torque and its joint, and so the largest force of a prismatic joint."""
    peaks, largest = plan.metrics.peak_joint_torques, dict[str, int]()
    for joint in sorted(range(len(peaks)), key=lambda joint: -peaks[joint]):
        unit = "N m, or N if it slides" if robot is None else robot.effort_unit(joint)
        largest.setdefault(unit, joint)
    return "; ".join(
        f"{peaks[joint]:.4g} {unit}, {plan.joint_names[joint]}"
        for unit, joint in sorted(largest.items(), reverse=True)
    )


def _at_rest(plan: Plan) -> list[tuple[str, str]]:
    """Return name and value of the system's rotation rate after the goal, with joints at rest."""
    rate = plan.turn_rate_at_rest
    return [] if rate is None else [("turns at rest", f"{np.rad2deg(rate):.4g} deg/s")]


def _wheel_rows(metrics: Metrics) -> list[tuple[str, str]]:
    """Return name and value of the largest momentum and torque of any wheel, if there are any."""
    return [
        (METRIC_BY_NAME[name].label, f"{metrics.told(name)}, wheel {np.argmax(peaks) + 1}")
        for name in ("peak_wheel_momenta", "peak_wheel_torques")
        if (peaks := getattr(metrics, name))
    ]


PHASES = ("phase", "lasts [s]", "joint path [rad]", "chaser turns [deg]", "nearest", "grasp takes")


def phase_rows(plan: Plan, goals: Sequence[ChaserGoal]) -> list[tuple[str, ...]]:
    """Return a row for each phase of a plan: `PHASES`.

    Args:
        goals: Attitudes of the chaser that are asked for at the goal of each phase.
    """
    rows = list[tuple[str, ...]]()
    for number, (one, goal) in enumerate(zip(plan.phases, goals, strict=False), start=1):
        metrics = one.metrics
        turns = f"{np.rad2deg(metrics.max_chaser_rotation):.2f}"
        if np.isfinite(goal.most):
            at_goal = METRIC_BY_NAME["final_chaser_rotation"].shown(metrics.final_chaser_rotation)
            turns += f", at the goal {at_goal}"
        near = min(metrics.min_clearance, metrics.min_self_clearance)
        force = [METRIC_BY_NAME[name].text(getattr(metrics, name)) for name in _OF_GRASP[:2]]
        impulse = METRIC_BY_NAME["capture_impulse"].text(metrics.capture_impulse)
        takes = impulse if np.isinf(metrics.peak_grasp_force) else ", ".join(force)
        rows.append(
            (
                str(number),
                f"{one.duration:.2f}" if one.duration else "-",
                f"{metrics.joint_path_length:.4f}",
                turns,
                METRIC_BY_NAME["min_clearance"].text(near),
                takes,
            )
        )
    return rows


def _finite_rows(metrics: Metrics) -> list[tuple[str, str]]:
    """Return name and value of the errors along a path, and of what a grasp takes; those known."""
    return [
        (METRIC_BY_NAME[name].label, metrics.told(name))
        for name in (*_OF_PATH, *_OF_GRASP)
        if np.isfinite(getattr(metrics, name))
    ]


def _limits(limits: Limits, plan: Plan) -> str:
    kept = ["joint positions"]
    if plan.wheels is not None:
        kept.append("momenta and torques of the wheels")
    if limits.joint_velocities:
        kept.append("joint velocities")
    if limits.joint_accelerations is not None:
        kept.append("joint accelerations")
    if limits.joint_torques:
        kept.append("joint torques")
    if np.isfinite(limits.chaser_attitude):
        kept.append(f"chaser Euler angle {np.rad2deg(limits.chaser_attitude):.2f} deg")
    if np.isfinite(limits.chaser_rotation):
        kept.append(f"chaser rotation {np.rad2deg(limits.chaser_rotation):.2f} deg")
    for name in ("grasp_force", "grasp_torque", "capture_impulse"):
        if np.isfinite(most := getattr(limits, name)):
            unit = declared_by_name(Limits)[name].unit
            kept.append(f"{name.replace('_', ' ')} {most:g} {unit}")
    return ", ".join(kept)
