"""An answer with a plan in words: for the log, and for diagnostics."""

from __future__ import annotations

import math

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.messages.plans import metrics_from_message
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.planning.motion.plan import Plan


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
