"""Tables of several methods' plans for one problem, and of the paper's ratios beside ours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.analysis.methods import (
    POTENTIAL_FIELD,
    SHORTEST,
    STEADIEST,
    STRAIGHT_LINE,
    Method,
)
from ff_planner_ros.errors import Failure, FfPlannerError
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem

COLUMNS = (
    "method",
    "joint path [rad]",
    "Euler angle [deg]",
    "clearance [mm]",
    "peak torque [N m]",
    "miss [mm]",
    "miss [deg]",
    "time [s]",
    "check",
)
RATIO_COLUMNS = ("ratio", "paper", "here")
_NOTHING = "-"


@dataclass(frozen=True, eq=False)
class Answer:
    """A method's plan for the problem, or its refusal."""

    plan: Plan | FfPlannerError  # passes the check or not; an error if the method found none
    failures: tuple[Failure, ...]  # of the check of the plan; empty: passed
    seconds: float  # wall time of search and check [s]


@dataclass(frozen=True)
class _Ratio:
    """A quotient of one metric of two methods, as the paper prints it in Sec. 5.1."""

    metric: str
    words: str
    above: Method
    below: Method
    printed: float


_PAPERS_RATIOS = (
    _Ratio("joint_path_length", "joint path", SHORTEST, STRAIGHT_LINE, 1 - 0.0265),
    _Ratio("joint_path_length", "joint path", SHORTEST, STEADIEST, 1 - 0.3237),
    _Ratio("joint_path_length", "joint path", POTENTIAL_FIELD, SHORTEST, 2.78),
    _Ratio("max_chaser_euler", "attitude", STEADIEST, STRAIGHT_LINE, 1 - 0.3346),
    _Ratio("max_chaser_euler", "attitude", STEADIEST, POTENTIAL_FIELD, 1 - 0.7063),
    _Ratio("max_chaser_euler", "attitude", STEADIEST, SHORTEST, 1 - 0.1824),
)


def comparison_rows(
    problem: PlanningProblem, answers: Mapping[Method, Answer]
) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `COLUMNS`, a row per method."""
    for method, answer in answers.items():
        seconds = f"{answer.seconds:.2f}"
        if isinstance(answer.plan, FfPlannerError):
            nothing = (_NOTHING,) * (len(COLUMNS) - 3)
            yield method.name, *nothing, seconds, answer.plan.status.name.lower()
            continue
        metrics = answer.plan.metrics
        found = [failure.status.name.lower() for failure in answer.failures]
        yield (
            method.name,
            f"{metrics.joint_path_length:.4f}",
            f"{np.rad2deg(metrics.max_chaser_euler):.2f}",
            f"{1e3 * metrics.min_clearance:.1f}" if problem.obstacles else _NOTHING,
            f"{max(metrics.peak_joint_torques):.2f}",
            f"{1e3 * metrics.final_position_error:.2f}",
            f"{np.rad2deg(metrics.final_orientation_error):.3f}",
            seconds,
            ", ".join(dict.fromkeys(found)) or "passed",
        )


def findings(answers: Mapping[Method, Answer]) -> Iterator[str]:
    """Yield a line for each method that failed: which constraint, where, by how much."""
    for method, answer in answers.items():
        if isinstance(answer.plan, FfPlannerError):
            yield f"{method.name}: {answer.plan}"
            continue
        found = [failure.finding for failure in answer.failures]
        if found:
            yield f"{method.name}: {'; '.join(found)} ({answer.plan.solver.stop_reason})"


def ratio_rows(answers: Mapping[Method, Answer]) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `RATIO_COLUMNS`; they compare only on the paper's own scenario.

    Args:
        answers: Of all `PAPERS_METHODS`.
    """
    for ratio in _PAPERS_RATIOS:
        above, below = (answers[method].plan for method in (ratio.above, ratio.below))
        here = _NOTHING
        if isinstance(above, Plan) and isinstance(below, Plan):
            quotient = getattr(above.metrics, ratio.metric) / getattr(below.metrics, ratio.metric)
            here = f"{quotient:.3f}"
        words = f"{ratio.words}, {ratio.above.name} / {ratio.below.name}"
        yield words, f"{ratio.printed:.3f}", here
