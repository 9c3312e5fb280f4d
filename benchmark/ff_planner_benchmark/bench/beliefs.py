"""Errors of plans that assume a wrong motion of the chaser, when the true system executes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_benchmark.bench.measurement import Measurement
from ff_planner_ros.baselines.beliefs import (
    executed,
    fixed_base,
    with_zero_momentum,
    zero_momentum,
)
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, attempted, in_frame_of_user, perform
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import KINDS, scenario

_HEADER = (
    *("class", "planned for", "scenarios", "plans", "collide", "miss, median [mm]"),
    *("worst [mm]", "median [deg]", "worst [deg]"),
)


@dataclass(frozen=True)
class BeliefResult:
    """The result of executing one plan."""

    kind: str  # class of the scenario
    robot: str
    number: int
    belief: str  # assumed motion of the chaser; a key of `BELIEFS`
    status: Status  # of the planner; solved does not mean that the plan arrives
    position_miss: float | None = None  # final error of the end effector [m]; None: no plan
    orientation_miss: float | None = None  # final error of the end effector [rad]; None: no plan
    collides: bool = False  # whether the arm is inside an obstacle at a point of the motion


def _free_floating(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    return executed(problem, perform(PlanningTask(problem, settings)), settings)


def _fixed_base_without_drift(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    return fixed_base(with_zero_momentum(problem), settings)


# The last is what others have checked: the true system has zero momentum, its chaser only reacts.
BELIEFS: dict[str, Callable[[PlanningProblem, PlannerSettings], Plan]] = {
    "the true momentum": _free_floating,
    "zero momentum": zero_momentum,
    "fixed base": fixed_base,
    "fixed base, no drift": _fixed_base_without_drift,
}


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` scenarios of each class under every belief, and execute the plans."""
    done = [each for kind in KINDS for each in belief_results(kind, count, settings)]
    rows = [
        (kind, belief, *_misses([e for e in done if (e.kind, e.belief) == (kind, belief)]))
        for kind in KINDS
        for belief in BELIEFS
    ]
    title = "Plans executed on the true free-floating system"
    return Measurement(done, [Table(title, _HEADER, rows)])


def _misses(group: Sequence[BeliefResult]) -> Iterator[str]:
    planned = [each for each in group if each.status is Status.SOLVED]
    yield from (f"{len(group)}", f"{len(planned)}")
    if not planned:
        yield from "-----"
        return
    miss = np.array([each.position_miss for each in planned], float) * 1e3
    turn = np.rad2deg(np.array([each.orientation_miss for each in planned], float))
    yield percent(sum(each.collides for each in planned) / len(planned), 0)
    yield from (f"{np.median(miss):.1f}", f"{miss.max():.1f}")
    yield from (f"{np.median(turn):.2f}", f"{turn.max():.2f}")


def belief_results(kind: str, count: int, settings: PlannerSettings) -> Iterator[BeliefResult]:
    """Plan `count` scenarios of a class under every belief, and execute the plans."""
    for index in range(count):
        number, robot = divmod(index, len(ROBOTS))
        for belief in BELIEFS:
            yield belief_result(kind, ROBOTS[robot], number, belief, settings)


def belief_result(
    kind: str, robot: str, number: int, belief: str, settings: PlannerSettings
) -> BeliefResult:
    """Plan one scenario under one belief, a key of `BELIEFS`, and execute the plan."""
    problem = scenario(kind, robot, number, turned=False).problem
    made, _ = attempted(PlanningTask(problem, settings), in_frame_of_user(BELIEFS[belief], problem))
    if isinstance(made, FfPlannerError):
        return BeliefResult(kind, robot, number, belief, made.status)
    metrics = made.metrics
    miss = metrics.final_position_error, metrics.final_orientation_error
    collides = metrics.penalty > 0.0
    return BeliefResult(kind, robot, number, belief, Status.SOLVED, *miss, collides)
