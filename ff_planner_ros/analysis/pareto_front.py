"""Pareto front of joint path and chaser attitude: plans of one task with several weights."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.task.task import PlanningTask, perform

# From min(L) to min(Theta). A radian of attitude is worth about ten of joint path where the two
# pull at a plan alike.
_WEIGHTS = (
    *(Objective(1.0, attitude) for attitude in (0.0, 2.0, 5.0, 10.0, 20.0, 50.0)),
    Objective(0.0, 1.0),
)
COLUMNS = ("--objective", "joint path [rad]", "Euler angle [deg]", "clearance [mm]", "time [s]")
_DOTS_PER_INCH = 150


@dataclass(frozen=True, eq=False)
class Point:
    """A plan of the Pareto front."""

    task: PlanningTask
    plan: Plan
    solve_time: float  # wall clock [s]

    @property
    def weights(self) -> str:
        """Value of `--objective` that gives this plan."""
        weights = self.task.problem.objective
        return f"{weights.joint_path_length:g},{weights.chaser_attitude:g}"

    @property
    def trade(self) -> tuple[float, float]:
        """Joint path length and largest Euler angle of the chaser [rad]."""
        return self.plan.metrics.joint_path_length, self.plan.metrics.max_chaser_euler


def pareto_front(task: PlanningTask, watch: Watch, clock: Callable[[], float]) -> list[Point]:
    """Return the Pareto-optimal plans of a task over `_WEIGHTS`, the shortest joint path first.

    Each plan is the one that its weights give by themselves. Weights without a plan are left out.

    Args:
        task: Its own objective is replaced.
        clock: Returns the time [s].

    Raises:
        InvalidInput: As `perform`.
        NoPlanFound: The time is over, or no weights give a plan.
    """
    points, refused = [], []
    for weights in _WEIGHTS:
        asked = replace(task, problem=replace(task.problem, objective=weights))
        begun = clock()
        try:
            points.append(Point(asked, perform(asked, watch), clock() - begun))
        except NoPlanFound as error:
            if error.status is Status.TIMED_OUT:
                raise
            refused.append(error)
    if not points:
        raise refused[0]
    return sorted(not_dominated(points), key=lambda point: point.trade)


def not_dominated(points: Sequence[Point]) -> Iterator[Point]:
    """Yield the Pareto-optimal points; of equal ones, the first."""
    for number, point in enumerate(points):
        at_least_as_good = (
            (other.trade != point.trade or place < number)
            and all(np.less_equal(other.trade, point.trade))
            for place, other in enumerate(points)
            if place != number
        )
        if not any(at_least_as_good):
            yield point


def front_rows(points: Sequence[Point]) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `COLUMNS`, a row per plan."""
    for point in points:
        shown = (
            METRIC_BY_NAME[name].shown(getattr(point.plan.metrics, name))
            for name in ("joint_path_length", "max_chaser_euler", "min_clearance")
        )
        yield point.weights, *shown, f"{point.solve_time:.2f}"


def front_dictionary(points: Sequence[Point]) -> dict[str, Any]:
    """Return the Pareto front as JSON: each plan without its motion."""
    return {
        "status": Status.SOLVED.name.lower(),
        "pareto_front": [
            {
                name: value
                for name, value in plan_dictionary(point.plan, point.task, point.solve_time).items()
                if name in ("objective", "digest", "coefficients", "metrics", "solver")
            }
            for point in points
        ],
    }


def save_front(points: Sequence[Point], directory: Path) -> Path:
    """Draw the Pareto front into a directory, created if missing, and return the PNG file."""
    from matplotlib.figure import Figure  # half a second, which the console does without

    directory.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes = figure.subplots()
    lengths, angles = np.array([point.trade for point in points]).T
    axes.plot(lengths, np.rad2deg(angles), "o-", drawstyle="steps-post")
    for point, length, angle in zip(points, lengths, np.rad2deg(angles), strict=True):
        axes.annotate(point.weights, (length, angle), (5, 5), textcoords="offset points")
    axes.set_xlabel("joint path length [rad]")
    axes.set_ylabel("largest Euler angle of the chaser [deg]")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.set_title("weights of joint path, attitude", fontsize=11)
    file = directory / "pareto_front.png"
    figure.savefig(file, dpi=_DOTS_PER_INCH)
    return file
