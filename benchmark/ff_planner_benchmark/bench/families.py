"""Both trajectory parameterisations on the same problems: success rate, time and objective."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ff_planner_benchmark.bench.measurement import (
    OBJECTIVES,
    Attempt,
    Measurement,
    median,
    misses,
    timed_plan,
)
from ff_planner_benchmark.problems import witnessed
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import KINDS, scenario

FAMILIES = (Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE)
# This part of a class is also planned for min(Theta), which takes ten times as long.
_STEADY = 1 / 8
_HEADER = (
    *("class", "objective", "problems", "paper's: solved", "splines: solved"),
    *("paper's: median [s]", "splines: median [s]", "joint path, splines / paper's"),
    "attitude, splines / paper's",
)


@dataclass(frozen=True)
class FamilyAttempt(Attempt):
    """The planner's result on one problem with one parameterisation."""

    kind: str
    objective: str  # key of `OBJECTIVES`
    number: int
    parametrisation: Parametrisation
    joint_path: float | None  # [rad]
    attitude: float | None  # [rad]


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` problems of each class with both parameterisations, and tabulate the results."""
    tried = list(family_attempts(count, settings))
    missed = [each for each in tried if each.parametrisation is Parametrisation.JOINT_SPLINE]
    table = Table("Path families side by side", _HEADER, [*_rows(tried)])
    return Measurement(tried, [table], misses(missed, "{0.kind} {0.number}, {0.objective}"))


def family_attempts(count: int, settings: PlannerSettings) -> Iterator[FamilyAttempt]:
    """Plan `count` problems of each class with both parameterisations."""
    for kind in (*KINDS, *witnessed.KINDS):
        for number in range(count):
            for name in ("min(L)", "min(Theta)"):
                if name == "min(L)" or (kind in KINDS and number < int(_STEADY * count)):
                    problem = replace(_problem(kind, number), objective=OBJECTIVES[name])
                    for family in FAMILIES:
                        asked = replace(problem, parametrisation=family)
                        made, outcome = timed_plan(PlanningTask(asked, settings))
                        lengths = (
                            (made.metrics.joint_path_length, made.metrics.max_chaser_euler)
                            if made
                            else (None, None)
                        )
                        yield FamilyAttempt(kind, name, number, family, *lengths, **outcome)


def _problem(kind: str, number: int) -> PlanningProblem:
    if kind in witnessed.KINDS:
        return witnessed.problem(kind, number)
    pair, robot = divmod(number, len(ROBOTS))
    return scenario(kind, ROBOTS[robot], pair, turned=False).problem


def _rows(tried: Sequence[FamilyAttempt]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each class and objective."""
    groups = dict.fromkeys((each.kind, each.objective) for each in tried)
    for kind, objective in groups:
        group = [each for each in tried if (each.kind, each.objective) == (kind, objective)]
        papers, splines = ([e for e in group if e.parametrisation is f] for f in FAMILIES)
        both = [(a, b) for a, b in zip(papers, splines, strict=True) if a.solved and b.solved]
        lengths = [b.joint_path / a.joint_path for a, b in both if a.joint_path and b.joint_path]
        angles = [b.attitude / a.attitude for a, b in both if a.attitude and b.attitude]
        yield (
            kind,
            objective,
            f"{len(papers)}",
            *(percent(sum(each.solved for each in one) / len(one)) for one in (papers, splines)),
            *(median([e.seconds for e in one if e.solved], 3) for one in (papers, splines)),
            *(median(ratios, 3) for ratios in (lengths, angles)),
        )
