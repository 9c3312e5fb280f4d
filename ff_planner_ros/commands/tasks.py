"""The task that the options of planning select."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.common.arrays import finite_number
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.watch import Budget, Watch
from ff_planner_ros.planning.problem.problem import Objective, Parametrisation
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.notes import notes_on_files
from ff_planner_ros.planning.task.task import PlanningTask

OBJECTIVES = {"length": Objective(1.0, 0.0), "attitude": Objective(0.0, 1.0)}


def task_of(scenario: Path, options: argparse.Namespace) -> tuple[PlanningTask, Watch]:
    """Return the task of a scenario with the options of planning, and the watch of its time.

    Raises:
        InvalidInput: The scenario, an option or a file that one names is refused.
    """
    parameters = load_parameters(options.parameters)
    defaults, seconds = Defaults(parameters.planner), options.time_budget
    if seconds is not None:
        finite_number("--time-budget", seconds, above=0.0)
    if options.parameters is not None:
        defaults = parameters.of_scenarios()
    task = load_task(scenario, defaults)
    print_notes(notes_on_files(task))
    if options.objective is not None:
        problem = replace(task.problem, objective=_weights(options.objective))
        task = replace(task, problem=problem)
    if options.parametrisation is not None:
        named = Parametrisation(options.parametrisation)
        task = replace(task, problem=replace(task.problem, parametrisation=named))
    if options.library is not None:
        task = _with_guess(task, options.library, "--library")
    elif parameters.library:
        task = _with_guess(task, Path(parameters.library), "planner.library")
    if seconds is None and options.parameters is None:
        return task, Watch()
    from ff_planner_ros.time_budget import TimeBudget

    if seconds is not None:
        return task, TimeBudget(Budget(seconds))
    return task, TimeBudget(parameters.budget(task.problem.objective.chaser_attitude > 0.0))


def _with_guess(task: PlanningTask, file: Path, field: str) -> PlanningTask:
    """Return a task with the nearest plan of a library as its initial guess, if it has none."""
    from ff_planner_ros.planning.scenario.library_file import load_library

    library = load_library(file, field)
    if task.first_guess is not None:
        print_notes(["the scenario has a first guess: the library is not asked for one"])
        return task
    guess = library.first_guess(task)
    if guess is None:
        print_notes([f"of the {len(library.plans)} plans in the library none is near"])
    return replace(task, first_guess=guess)


def _weights(text: str) -> Objective:
    """Return the weights that `--objective` names or gives."""
    if text in OBJECTIVES:
        return OBJECTIVES[text]
    try:
        length, attitude, *duration = map(float, text.split(","))
        return Objective(length, attitude, *duration)
    except (ValueError, TypeError):
        names = ", ".join(OBJECTIVES)
        allowed = f"it must be one of {names}, or two weights such as 1,10 and that of the duration"
        raise InvalidInput(Status.UNSUPPORTED, "--objective", text, allowed) from None
