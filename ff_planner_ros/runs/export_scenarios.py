"""Export of a bag's tasks as scenario files, from which `ff-planner plan` plans again."""

from __future__ import annotations

from collections.abc import Container
from itertools import chain, count
from pathlib import Path

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import BagError, FfPlannerError
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.runs.replay import replayable


def export_scenarios(bag: Path, directory: Path) -> tuple[str, ...]:
    """Write each recorded task to a file named by its plan id in a new directory.

    Of tasks with one plan id, the files of the later ones end in `_2`, `_3` and so on.

    Returns:
        Notes: what is wrong with the bag, which requests are left out.

    Raises:
        BagError: The bag cannot be read, holds no request, or the directory exists.
    """
    left_out, taken = list[str](), set[str]()
    with open_bag(bag) as opened:
        for one in replayable(opened):
            if not taken and not left_out:
                _make(directory)
            try:
                task = one.planned_task()
                name = _free_name(one.plan_id.replace("/", "_") or "request", taken)
                write_scenario(task, directory / f"{name}.yaml")
                taken.add(name)
            except FfPlannerError as error:
                left_out.append(f"{one.plan_id} is left out: {error}")
        return (*opened.notes, *left_out)


def _make(directory: Path) -> None:
    try:
        directory.mkdir(parents=True)
    except FileExistsError:
        raise BagError(f"{directory} exists: choose another directory") from None


def _free_name(name: str, taken: Container[str]) -> str:
    numbered = (f"{name}_{number}" for number in count(2))
    return next(one for one in chain([name], numbered) if one not in taken)
