"""Our plans on the data set, executed in two independent physics engines, MuJoCo and Drake."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ff_planner_benchmark.dataset import CLASSES
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform

HEADER = (
    *("class", "plans", "worst miss in MuJoCo [mm]", "[deg]"),
    *("worst miss in Drake [mm]", "[deg]"),
)


def flown_rows(directory: Path, each: int) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `HEADER` for each class: largest final errors of the end effector.

    Raises:
        FfPlannerError: MuJoCo or Drake is not installed.
    """
    from ff_planner_benchmark.second_engine import flown_in_drake
    from ff_planner_ros.simulation.verification import verify

    settings = load_parameters().planner
    for kind in CLASSES:
        misses = list[tuple[float, float, float, float]]()
        for file in sorted((directory / "scenarios" / kind).glob("*.yaml"))[:each]:
            problem = load_scenario(file)
            try:
                motion = perform(PlanningTask(problem, settings)).trajectory
            except NoPlanFound:
                continue
            first = verify(problem.robot, motion).deviation
            second = flown_in_drake(problem.robot, motion)
            errors = first.final_position_error, first.final_orientation_error
            misses.append((*errors, second.position, second.orientation))
        worst = [max(column) for column in zip(*misses, strict=True)] or [float("nan")] * 4
        to_mm, to_deg = 1e3, 57.29577951308232
        units = (to_mm, to_deg, to_mm, to_deg)
        yield (
            kind,
            f"{len(misses)}",
            *(f"{unit * value:.4f}" for unit, value in zip(units, worst, strict=True)),
        )
