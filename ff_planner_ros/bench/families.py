"""Both path families on the same problems: how often, how fast and how good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.bench.success import Stopwatch
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.problem.problem import Objective, Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import witnessed
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import KINDS, scenario

FAMILIES = (Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE)
OBJECTIVES = {"min(L)": Objective(1.0, 0.0), "min(Theta)": Objective(0.0, 1.0)}
# Of each class this part is planned for the least attitude, too, which takes ten times as long.
_STEADY = 1 / 8


@dataclass(frozen=True)
class FamilyAttempt:
    """What became of one problem in one family."""

    kind: str
    objective: str  # key of `OBJECTIVES`
    number: int
    parametrisation: Parametrisation
    status: Status
    message: str  # cause of a miss; empty if solved
    seconds: float  # that the planner took
    joint_path: float | None  # [rad]
    attitude: float | None  # [rad]

    @property
    def solved(self) -> bool:
        """Whether there is a plan, and it is sound."""
        return self.status is Status.SOLVED


def family_attempts(count: int, settings: PlannerSettings) -> Iterator[FamilyAttempt]:
    """Plan so many problems of each class in both families."""
    for kind in (*KINDS, *witnessed.KINDS):
        for number in range(count):
            for name, objective in OBJECTIVES.items():
                if name == "min(L)" or (kind in KINDS and number < int(_STEADY * count)):
                    problem = replace(_problem(kind, number), objective=objective)
                    for family in FAMILIES:
                        yield _attempt(kind, name, number, problem, family, settings)


def _problem(kind: str, number: int) -> PlanningProblem:
    if kind in witnessed.KINDS:
        return witnessed.problem(kind, number)
    pair, robot = divmod(number, len(ROBOTS))
    return scenario(kind, ROBOTS[robot], pair, turned=False).problem


def _attempt(
    kind: str,
    objective: str,
    number: int,
    problem: PlanningProblem,
    family: Parametrisation,
    settings: PlannerSettings,
) -> FamilyAttempt:
    stopwatch = Stopwatch()
    status, message, joint_path, attitude = Status.SOLVED, "", None, None
    try:
        task = PlanningTask(replace(problem, parametrisation=family), settings)
        metrics = perform(task, method=stopwatch).metrics
        joint_path, attitude = metrics.joint_path_length, metrics.max_chaser_euler
    except FfPlannerError as error:
        status, message = error.status, str(error)
    seconds = stopwatch.seconds
    return FamilyAttempt(
        kind, objective, number, family, status, message, seconds, joint_path, attitude
    )


def side_by_side(tried: list[FamilyAttempt]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each class and objective: `HEADER`."""
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
            *(f"{sum(each.solved for each in one) / len(one):.1%}" for one in (papers, splines)),
            *(_median([e.seconds for e in one if e.solved], 3) for one in (papers, splines)),
            *(_median(ratios, 3) for ratios in (lengths, angles)),
        )


HEADER = (
    *("class", "objective", "problems", "paper's: solved", "splines: solved"),
    *("paper's: median [s]", "splines: median [s]", "joint path, splines / paper's"),
    "attitude, splines / paper's",
)


def _median(values: list[float], digits: int) -> str:
    return f"{np.median(values):.{digits}f}" if values else "-"
