"""Plans, metrics and reports on the search, read out of answers."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.messages.trajectories import begin_of, trajectory_of
from ff_planner_ros.messages.wheels import wheels_of
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport

if TYPE_CHECKING:  # what is read may also be a message decoded where ROS is not installed
    from ff_planner_msgs.msg import PlanAnswer, PlanMetrics
    from ff_planner_msgs.msg import SolverReport as SolverReportMessage


def plan_from_answer(answer: PlanAnswer) -> Plan:
    """Read the plan back out of an answer whose status is SOLVED, all phases as one.

    Its times are rounded to nanoseconds; it holds NaN where the answer leaves something out.

    Raises:
        ValueError: Arrays of the answer do not fit each other.
    """
    message, *others = answer.plans
    return Plan(
        joint_names=tuple(message.joint_trajectory.joint_names),
        trajectory=trajectory_of(answer),
        xi=np.concatenate([one.xi for one in answer.plans]),
        orientation_reading="" if others else message.orientation_reading,
        family="" if others else message.family,
        metrics=metrics_from_message(answer.metrics[0]),
        solver=solver_report_from_message(answer.solver),
        duration=begin_of(answer, len(others)) + answer.plans[-1].duration or None,
        effort=answer.effort,
        wheels=wheels_of(answer),
    )


def metrics_from_message(message: PlanMetrics) -> Metrics:
    """Read the metrics of a plan or of the best attempt."""
    values: dict[str, Any] = {item.name: value_at(message, item.name) for item in fields(Metrics)}
    for name, value in values.items():
        if not isinstance(value, str | float):
            values[name] = tuple(value)
    return Metrics(**values)


def solver_report_from_message(message: SolverReportMessage) -> SolverReport:
    """Read the report on the search from an answer."""
    return SolverReport(**{one.name: value_at(message, one.name) for one in fields(SolverReport)})
