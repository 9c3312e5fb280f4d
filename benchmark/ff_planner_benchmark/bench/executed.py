"""Plans executed: of planners with wrong beliefs by the true system, and of all in two engines."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import SOLVED, Cell, Experiment, Row, each, is_solved
from ff_planner_benchmark.problems.classes import CLASSES, SCENARIOS, STILL, ProblemClass
from ff_planner_ros.baselines.beliefs import (
    executed,
    fixed_base,
    with_zero_momentum,
    zero_momentum,
)
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.task import PlanningTask, attempted, in_frame_of_user, perform


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


def _believed(one: ProblemClass, index: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a scenario under every belief, and execute the plans; solved is not that one arrives."""
    for belief, method in BELIEFS.items():
        task = one.task(index, settings)
        made, _ = attempted(task, in_frame_of_user(method, task.problem))
        row: Row = {"kind": one.name, "robot": one.robot(index), "belief": belief}
        row |= {"number": index // len(one.robots), "status": SOLVED, "collides": False}
        row |= {"position_miss": None, "orientation_miss": None}
        if isinstance(made, FfPlannerError):
            row["status"] = made.status.name
        else:
            row["position_miss"] = made.metrics.final_position_error
            row["orientation_miss"] = made.metrics.final_orientation_error
            row["collides"] = made.metrics.penalty > 0.0
        yield row


EXECUTIONS = Experiment(
    "executions",
    "Plans executed on the true free-floating system",
    each(SCENARIOS, _believed),
    {"class": "kind", "planned for": "belief"},
    {
        "scenarios": columns.count,
        "plans": columns.number_of(is_solved),
        "collide": columns.among(columns.share(lambda row: row["collides"], 0), is_solved),
        "miss, median [mm]": columns.value("position_miss", form=".1f", unit=1e3),
        "worst [mm]": columns.value("position_miss", max, ".1f", 1e3),
        "median [deg]": columns.value("orientation_miss", form=".2f", unit=float(np.rad2deg(1.0))),
        "worst [deg]": columns.value("orientation_miss", max, ".2f", float(np.rad2deg(1.0))),
    },
    most=40,  # as many as in a published check by others
)


def _flown(one: ProblemClass, index: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a task, and execute the plan of each phase in MuJoCo and in Drake."""
    from ff_planner_benchmark.second_engine import flown_in_drake
    from ff_planner_ros.simulation.verification import verify

    task, labels = one.task(index, settings), {"kind": one.name, "number": index}
    try:
        plan = perform(task)
    except FfPlannerError as error:
        names = ("passed", *(f"{name}_{engine}" for engine in _ENGINES for name in _MISSES))
        yield labels | {"status": error.status.name} | dict.fromkeys(names)
        return
    for phase, made in phase_tasks(task, plan):
        problem, motion = phase.problem, made.trajectory
        first = verify(problem.robot, motion, scene_of(problem))
        off, second = first.deviation, flown_in_drake(problem.robot, motion)
        yield labels | {
            "status": SOLVED,
            "passed": first.passed,
            "position_mujoco": off.final_position_error,
            "orientation_mujoco": off.final_orientation_error,
            "chaser_mujoco": off.max_chaser_position_error,
            "position_drake": second.position,
            "orientation_drake": second.orientation,
            "chaser_drake": second.chaser,
        }


_ENGINES = {"mujoco": "MuJoCo", "drake": "Drake"}
_MISSES = {
    "position": ("end effector [mm]", 1e3),
    "orientation": ("end effector [deg]", float(np.rad2deg(1.0))),
    "chaser": ("chaser [mm]", 1e3),
}
_WORST: dict[str, Cell] = {
    f"{called}: {words}": columns.value(f"{name}_{engine}", max, ".4f", unit)
    for engine, called in _ENGINES.items()
    for name, (words, unit) in _MISSES.items()
}
ENGINES = Experiment(
    "engines",
    "Plans executed in two engines, largest deviations",
    each((*CLASSES, *STILL), _flown),
    {"class": "kind"},
    {
        "plans": columns.number_of(is_solved),
        "no plan": columns.number_of(lambda row: not is_solved(row)),
        "passed in MuJoCo": columns.number_of(lambda row: row["passed"]),
        **_WORST,
    },
)
