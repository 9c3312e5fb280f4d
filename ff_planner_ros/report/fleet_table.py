"""The answers in many bags as one table in Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow
import pyarrow.parquet

from ff_planner_ros.bag.export import written_new
from ff_planner_ros.errors import BagError
from ff_planner_ros.report.fleet import Fleet
from ff_planner_ros.report.statistics import Row


def save_fleet_table(fleet: Fleet, file: Path) -> None:
    """Write a row for each answer into a new Parquet file.

    Calls of `~/publish_plan`, if there are any, go into `NAME_publications.parquet` beside it.

    Raises:
        BagError: A file exists already, there is no answer, or one cannot be written.
    """
    if not fleet.rows:
        raise BagError(f"the bags in {fleet.directory} hold no request to a planner")
    _save(fleet.rows, file)
    if fleet.publications:
        _save(fleet.publications, publications_beside(file))


def publications_beside(file: Path) -> Path:
    """Return the file of the calls of `~/publish_plan`, beside that of the answers."""
    return file.with_name(f"{file.stem}_publications{file.suffix}")


def _save(rows: Sequence[Row], file: Path) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    by_column = {name: [row.get(name) for row in rows] for name in columns}
    made = pyarrow.table({name: _column(values) for name, values in by_column.items()})
    with written_new(file), file.open("xb") as stream:
        pyarrow.parquet.write_table(made, stream, compression="zstd")


def _column(values: list[object]) -> pyarrow.Array:
    """Return a column of the narrowest type of all its values: bool, int, float or text."""
    known = [one for one in values if one is not None]
    if all(isinstance(one, bool) for one in known) and known:
        return pyarrow.array(values, pyarrow.bool_())
    if all(isinstance(one, int) for one in known) and known:
        return pyarrow.array(values, pyarrow.int64())
    if all(isinstance(one, int | float) for one in known):
        return pyarrow.array([None if v is None else float(v) for v in values], pyarrow.float64())  # type: ignore[arg-type]
    return pyarrow.array([None if v is None else str(v) for v in values], pyarrow.string())
