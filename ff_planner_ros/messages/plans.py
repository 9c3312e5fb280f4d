"""Plans, metrics and reports on the search, read out of answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages.trajectories import begin_of, trajectory_of
from ff_planner_ros.messages.wheels import wheels_of
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.task.planning_task import PlanningTask

if TYPE_CHECKING:  # what is read may also be a message decoded where ROS is not installed
    from ff_planner_msgs.msg import Plan as PlanMessage
    from ff_planner_msgs.msg import PlanAnswer, PlanMetrics
    from ff_planner_msgs.msg import SolverReport as SolverReportMessage


def plan_from_answer(answer: PlanAnswer) -> Plan:
    """Read the plan back out of an answer whose status is SOLVED, all phases as one.

    Its times are rounded to nanoseconds; it holds NaN where the answer leaves something out.

    Raises:
        ValueError: Arrays of the answer do not fit each other.
    """
    return _plan(answer, answer.plans)


def plan_of_task(task: PlanningTask, answer: Any) -> Plan:
    """Read the plans of an answer to a task: the first phase's, those that follow in its `then`.

    The metrics of each are those of the answer. Otherwise as `plan_from_answer`.

    Args:
        answer: From ROS or as it was decoded; its status is SOLVED.

    Raises:
        InvalidInput: The answer is damaged, or is one to another task.
    """
    robot, most = task.problem.robot, 1 + len(task.then)
    try:
        phases = [_plan(answer, [one]) for one in answer.plans]
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        raise InvalidInput(Status.OUT_OF_RANGE, "plans", "damaged", str(error)) from None
    if not 1 <= len(phases) <= most:
        allowed = f"it must be one of each phase, up to {most}"
        raise InvalidInput(Status.WRONG_SIZE, "plans", f"{len(phases)} plans", allowed)
    for one in phases:
        if one.joint_names != robot.joint_names:
            names, wanted = ", ".join(one.joint_names), ", ".join(robot.joint_names)
            allowed = f"the robot of the task has {wanted}"
            raise InvalidInput(Status.UNKNOWN_JOINT, "joint_trajectory.joint_names", names, allowed)
        require_sound_samples(robot, one.trajectory)
    return replace(phases[0], then=tuple(phases[1:]))


def _plan(answer: PlanAnswer, plans: Sequence[PlanMessage]) -> Plan:
    message, *others = plans
    return Plan(
        joint_names=tuple(message.joint_trajectory.joint_names),
        trajectory=trajectory_of(plans),
        xi=np.concatenate([one.xi for one in plans]),
        orientation_reading="" if others else message.orientation_reading,
        family="" if others else message.family,
        metrics=metrics_from_message(answer.metrics[0]),
        solver=solver_report_from_message(answer.solver),
        duration=begin_of(plans, len(others)) + plans[-1].duration or None,
        effort=message.effort,
        wheels=wheels_of(plans),
    )


def metrics_from_message(message: PlanMetrics) -> Metrics:
    """Read the metrics of a plan or of the best attempt."""
    # What older messages lack, they do not know.
    values: dict[str, Any] = {
        item.name: value_at(message, item.name, item.default) for item in fields(Metrics)
    }
    for name, value in values.items():
        if not isinstance(value, str | float):
            values[name] = tuple(value)
    return Metrics(**values)


def solver_report_from_message(message: SolverReportMessage) -> SolverReport:
    """Read the report on the search from an answer."""
    return SolverReport(**{one.name: value_at(message, one.name) for one in fields(SolverReport)})
