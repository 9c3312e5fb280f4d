"""What became of a request, as its answer: a plan, or why there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict

from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PlanAnswer, PlanMetrics, PlanStatus, SolverReport

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.messages.plans import metrics_from_message
from ff_planner_ros.messages.status import status_fields
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import bodies_of, whole
from ff_planner_ros.ros.messages.to_messages import plan_message


def answer_of(
    outcome: Plan | FfPlannerError,
    plan_id: str,
    solve_time: float,
    task: PlanningTask | None = None,
    start_ns: int = 0,
    inertial_frame: str = "",
) -> PlanAnswer:
    """Return the answer to a request; its `inputs` stay empty.

    That to a refusal holds metrics and solver report of the best attempt, if there is one, but not
    its motion, and the plans of the phases before the one that failed.

    Args:
        solve_time: From request to outcome [s].
        task: The task, with the efforts of the outcome; None: the request was not read.
        start_ns: Time of the first point of a plan [ns].
    """
    found = outcome if isinstance(outcome, Plan) else getattr(outcome, "found", None)
    if isinstance(outcome, Plan):
        total = whole(outcome)
        reported: Plan | None = total
        status = PlanStatus(code=int(Status.SOLVED), message=total.message)
    else:
        attempt = outcome.attempt if isinstance(outcome, NoPlanFound) else None
        reported = attempt if isinstance(attempt, Plan) else None
        status = status_message(outcome)
    answer = PlanAnswer(status=status, plan_id=plan_id)
    if reported is not None:
        answer.metrics = [PlanMetrics(**asdict(reported.metrics))]
        answer.solver = SolverReport(solve_time=solve_time, **asdict(reported.solver))
    if isinstance(found, Plan):
        bodies = [None] * len(found.phases) if task is None else bodies_of(task, found)
        answer.plans = _phases(found, start_ns, inertial_frame, bodies)
    if task is not None:
        answer.task_digest = task.digest
        for plan in answer.plans:
            plan.geometry = task.problem.robot.geometry.value
    return answer


def status_message(error: FfPlannerError) -> PlanStatus:
    """Return an error as a status, with its `status_fields`."""
    return PlanStatus(**status_fields(error))


def _phases(
    plan: Plan, start_ns: int, inertial_frame: str, bodies: Sequence[TargetBody | None]
) -> list[PlanMessage]:
    """Return the plan of each phase as a message.

    Args:
        bodies: Target body that each phase captures, at the phase's first point; None: none.
    """
    written = list[PlanMessage]()
    for phase, body in zip(plan.phases, bodies, strict=True):
        captured = None if body is None else CapturedBody(body)
        written.append(plan_message(phase, start_ns, inertial_frame, captured))
        start_ns += round(float(phase.trajectory.time[-1]) * NANOSECONDS)
    return written


def solved_in_words(plan: Plan, answer: PlanAnswer) -> str:
    """Return the line of the log for a request that got a plan."""
    metrics, solver, path = answer.metrics[0], answer.solver, plan.metrics.joint_path_length
    robust = "" if plan.robust is None else f"{plan.robust.told(path)}, "
    notes = "".join(f"{in_log(note)}, " for note in plan.notes)
    near = ", ".join(f"{label} {words}" for label, words in clearances_in_words(answer).items())
    return (
        f"{answer.plan_id}: SOLVED: joint path {metrics.joint_path_length:.4f} rad, "
        f"largest Euler angle {math.degrees(metrics.max_chaser_euler):.2f} deg, "
        f"rotation {math.degrees(metrics.max_chaser_rotation):.2f} deg, "
        f"{in_log(near)}, {robust}{notes}{solver.iterations} iterations, "
        f"{solver.solve_time:.2f} s"
    )


def clearances_in_words(answer: PlanAnswer) -> dict[str, str]:
    """Return the plan's minimum clearances in words, by the labels of the metrics."""
    metrics = metrics_from_message(answer.metrics[0])
    names = ("min_clearance", "min_self_clearance")
    return {METRIC_BY_NAME[name].label: metrics.told(name) for name in names}
