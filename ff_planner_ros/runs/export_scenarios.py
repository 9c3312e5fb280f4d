"""Export of a bag's requests as scenario files, from which `ff-planner plan` plans again."""

from __future__ import annotations

from collections.abc import Container
from itertools import chain, count
from pathlib import Path

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import BagError, FfPlannerError
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.runs.recorded_run import recorded_run


def export_scenarios(bag: Path, directory: Path) -> tuple[str, ...]:
    """Write each request that can be rebuilt to a file named by its plan id in a new directory.

    Of requests with one plan id, the files of the later ones end in `_2`, `_3` and so on.

    Returns:
        Notes: what is wrong with the bag, what had to be assumed, which requests are left out.

    Raises:
        BagError: The bag cannot be read, holds no request, or the directory exists.
        InvalidInput: The URDF in the bag is invalid.
    """
    with open_bag(bag) as opened:
        run = recorded_run(opened)
    try:
        directory.mkdir(parents=True)
    except FileExistsError:
        raise BagError(f"{directory} exists: choose another directory") from None
    notes, taken = list(run.notes), set[str]()
    for recorded in run.requests:
        try:
            task = recorded.read_request().task
            name = _free_name(recorded.name.replace("/", "_"), taken)
            write_scenario(task, directory / f"{name}.yaml")
            taken.add(name)
        except FfPlannerError as error:
            notes.append(f"{recorded.name} is left out: {error}")
    return tuple(notes)


def _free_name(name: str, taken: Container[str]) -> str:
    numbered = (f"{name}_{number}" for number in count(2))
    return next(one for one in chain([name], numbered) if one not in taken)
