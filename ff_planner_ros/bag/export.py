"""Export of a bag's plans: a directory of CSV files, or one NPZ file of numpy."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ff_planner_ros.bag.plans import RecordedPlan, recorded_plans
from ff_planner_ros.bag.publications import Publication, publications
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import BagError

# The tables of all answers, and of the requests to publish one, beside the plans
ANSWERS, PUBLICATIONS = "answers", "publications"
# What a spreadsheet takes for a formula, or for the end of the cell before it.
_FORMULA, _BREAKS = "=+-@\uff1d\uff0b\uff0d\uff20", "\t\r\n"
_A_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)", re.ASCII)
_LONGEST_NAME = 100  # [characters] of a file; a plan id from a damaged bag may be anything


def export_csv(bag: Path, directory: Path) -> Sequence[str]:
    """Write tables of all answers and of every plan into a new directory; return the notes.

    If the bag has requests to publish waiting plans, they get a table, too.

    Raises:
        BagError: Nothing of the bag can be read, it holds no answer, or the directory exists or
            cannot be written.
    """
    plans, published, notes = _plans(bag)
    with written_new(directory):
        directory.mkdir(parents=True)
        answers, asked = [plan.row() for plan in plans], [one.row() for one in published]
        for table, rows in ((ANSWERS, answers), (PUBLICATIONS, asked)):
            if rows:
                cells = [list(row.values()) for row in rows]
                _write(directory / f"{table}.csv", list(rows[0]), cells)
        for name, plan in _named(plans):
            columns = plan.columns()
            values = np.column_stack(list(columns.values())).tolist()
            _write(directory / f"{name}.csv", list(columns), values)
    return notes


def export_npz(bag: Path, file: Path) -> Sequence[str]:
    """Write the arrays of every plan into a new file, as `plan_id/array`; return the notes.

    Raises:
        BagError: Nothing of the bag can be read, it holds no answer, or the file exists or cannot
            be written.
    """
    plans, _, notes = _plans(bag)
    arrays: dict[str, Any] = {}
    for name, plan in _named(plans):
        for item in fields(plan.trajectory):  # type: ignore[arg-type]
            arrays[f"{name}/{item.name}"] = getattr(plan.trajectory, item.name)
        arrays |= {f"{name}/target_body/{part}": rows for part, rows in plan.target_body.items()}
        arrays[f"{name}/joint_names"] = np.array(plan.joint_names)
        arrays[f"{name}/start_ns"] = np.array(plan.start_ns)
        arrays |= {f"{name}/metrics/{key}": np.array(value) for key, value in plan.metrics.items()}
    with written_new(file), file.open("xb") as stream:
        np.savez_compressed(stream, **arrays)
    return notes


@contextmanager
def written_new(path: Path) -> Iterator[None]:
    """Say which file or directory is in the way, or cannot be written, while it is written.

    Raises:
        BagError: It is there, or cannot be written.
    """
    try:
        yield
    except FileExistsError:
        raise BagError(f"{path} exists already, and is not overwritten") from None
    except OSError as error:
        raise BagError(f"{path} cannot be written: {error}") from None


def _plans(bag: Path) -> tuple[list[RecordedPlan], list[Publication], Sequence[str]]:
    with open_bag(bag) as opened:
        plans, published = recorded_plans(opened), publications(opened)
        notes = opened.notes
    if not plans:
        words = f" ({'; '.join(notes)})" if notes else ""
        raise BagError(f"bag {bag} holds no answer of the planner{words}")
    return plans, published, notes


def _named(plans: Sequence[RecordedPlan]) -> Iterator[tuple[str, RecordedPlan]]:
    """Yield the plans with a trajectory, with unique names that any file system accepts."""
    taken = {ANSWERS, PUBLICATIONS}
    for plan in plans:
        if plan.trajectory is not None:
            stem = (
                re.sub(r"[^\w.-]|^\.", "_", plan.plan_id, flags=re.ASCII)[:_LONGEST_NAME] or "plan"
            )
            name, number = stem, 2
            while name.lower() in taken:
                name, number = f"{stem}_{number}", number + 1
            taken.add(name.lower())
            yield name, plan


def _write(file: Path, names: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    with file.open("x", newline="", encoding="utf-8") as stream:
        # A text in quotes stays one cell where a spreadsheet takes ; or a tab for the separator.
        writer = csv.writer(stream, quoting=csv.QUOTE_NONNUMERIC)
        writer.writerow(map(_cell, names))
        writer.writerows([_cell(value) for value in row] for row in rows)


def _cell(value: Any) -> Any:
    """Return the content of a cell; a text that a spreadsheet would compute gets a ' in front."""
    if not isinstance(value, str) or _A_NUMBER.fullmatch(value):
        return value
    computed = value.lstrip()[:1] in _FORMULA or value[:1] in _BREAKS
    return f"'{value}" if value and computed else value
