"""Every class of problems, by name; experiments and the data set draw from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from ff_planner_benchmark.problems import (
    all_features,
    captured,
    joint_goals,
    shapes,
    still_goals,
    tumbling,
    witnessed,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems import bodies, scenarios
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.problems.robots import ROBOTS


@dataclass(frozen=True)
class ProblemClass:
    """A class of problems; the same number is always the same problem."""

    name: str
    robots: tuple[str, ...]  # in turn
    draw: Callable[[int], Drawn[Any]]  # by number

    def robot(self, number: int) -> str:
        """Return the name of a problem's robot."""
        return self.robots[number % len(self.robots)]

    def task(self, number: int, settings: PlannerSettings) -> PlanningTask:
        """Return a problem as a task, with all its phases."""
        return self.draw(number).task(settings)


def _in_turn(
    draw: Callable[[str, int], Drawn[Any]], robots: tuple[str, ...] = ROBOTS
) -> Callable[[int], Drawn[Any]]:
    """Return a draw by number alone, the robots in turn, of one by robot and number."""
    return lambda number: draw(robots[number % len(robots)], number // len(robots))


SCENARIOS = tuple(
    ProblemClass(kind, ROBOTS, _in_turn(partial(scenarios.scenario, kind, turned=False)))
    for kind in scenarios.KINDS
)
BODIES = ProblemClass("bodies", bodies.ROBOTS, _in_turn(bodies.problem, bodies.ROBOTS))
SHAPES = ProblemClass("shapes", shapes.ROBOTS, shapes.problem)
ALL_FEATURES = ProblemClass("all features", all_features.ROBOTS, all_features.problem)
WITNESSED, STILL, TUMBLING = (
    tuple(
        ProblemClass(called.format(name), kind.robots, partial(module.drawn, name))
        for name, kind in module.KINDS.items()
    )
    # The data set's are called as others here are
    for module, called in ((witnessed, "{}"), (still_goals, "data set, {}"), (tumbling, "{}"))
)
JOINT_GOALS = tuple(
    ProblemClass(kind, robots, partial(joint_goals.problem, kind))
    for kind, robots in joint_goals.KINDS.items()
)
CAPTURED = tuple(
    ProblemClass(kind, captured.ROBOTS, partial(captured.problem, kind)) for kind in captured.KINDS
)
CLASSES = (
    *(*SCENARIOS, *WITNESSED, BODIES, SHAPES, *TUMBLING, ALL_FEATURES),
    *(*JOINT_GOALS, *CAPTURED),
)
