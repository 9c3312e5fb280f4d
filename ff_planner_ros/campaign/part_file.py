"""Reading a file of the table of plans: bounded, and whole or refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.compute
import pyarrow.parquet

from ff_planner_ros.baselines import METHODS
from ff_planner_ros.common.shown import LONGEST_VALUE, printable, quoted
from ff_planner_ros.common.text_file import read_bytes
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.metrics import Metrics

_ID = re.compile(r"[0-9a-f]{16}")  # as `Case.id` makes it
TEXT, NUMBER, WHOLE = pyarrow.string(), pyarrow.float64(), pyarrow.int64()
NUMBERS = pyarrow.list_(NUMBER)
CHANGE = "change."  # begins the columns of what is varied
KINDS = {"number": NUMBER, "numbers": NUMBERS, "text": TEXT}
BEFORE_METRICS: Mapping[str, pyarrow.DataType] = {
    "id": TEXT,
    "number": WHOLE,
    "source": TEXT,
    "method": TEXT,
    "planned_by": TEXT,
    "settings": TEXT,
    "drawn": pyarrow.bool_(),
    "digest": TEXT,
    "geometry": TEXT,
    "status": TEXT,
    "solved": pyarrow.bool_(),
    "message": TEXT,
    "solve_time": NUMBER,
    "parametrisation": TEXT,
    "motion_digest": TEXT,
    "starts": WHOLE,
    "iterations": WHOLE,
    "rollouts": WHOLE,
    "optimality": NUMBER,
    "coefficients": NUMBERS,
    "kind": TEXT,
    "place": NUMBERS,
}
_ALWAYS_THERE = (
    *("id", "number", "source", "method", "planned_by", "settings", "changes"),
    *("status", "solved"),
)
# A file of ours has 1,000 rows of 1 kB or so.
_MOST_BYTES, _MOST_ROWS, _MOST_COLUMNS = 32_000_000, 20_000, 1000


def metric_columns() -> dict[str, pyarrow.DataType]:
    """Return the columns of the metrics, with their types."""
    metrics = {}
    for item in fields(Metrics):
        metrics[item.name] = NUMBER
        if item.name.startswith("peak_"):  # one of each joint, or of each wheel
            metrics[item.name] = NUMBERS
        elif item.name.endswith("_pair"):
            metrics[item.name] = TEXT
    return metrics


def part_schema(path: Path) -> pyarrow.Schema:
    """Return the columns of a file of the table.

    Raises:
        InvalidInput: It is damaged, too large, or no file of a campaign.
    """
    return _opened(path).schema_arrow


def read_part(path: Path, columns: Sequence[str] | None = None) -> pyarrow.Table:
    """Return the rows of a file of the table, or some of its columns.

    Raises:
        InvalidInput: It is damaged, too large, or no file of a campaign.
    """
    file = _opened(path)
    try:
        table = file.read(list(columns) if columns else None)
        table.validate(full=True)
        _require_values(table)
    except Exception as error:  # whatever Arrow trips over in a damaged file
        raise _damaged(path, error) from None
    return table


def _opened(path: Path) -> pyarrow.parquet.ParquetFile:
    """Return an open file, which has the columns of a campaign and is not too large."""
    source = pyarrow.BufferReader(read_bytes(path, _MOST_BYTES))
    try:
        file = pyarrow.parquet.ParquetFile(source, page_checksum_verification=True)
        _require_moderate(file.metadata)
        _require_columns(file.schema_arrow)
    except Exception as error:  # whatever Arrow trips over in a damaged file
        raise _damaged(path, error) from None
    return file


def _require_moderate(told: pyarrow.parquet.FileMetaData) -> None:
    """Refuse a file that would become too large in memory."""
    if told.num_rows > _MOST_ROWS or told.num_columns > _MOST_COLUMNS:
        raise ValueError(f"it has {told.num_rows} rows and {told.num_columns} columns")
    groups = map(told.row_group, range(told.num_row_groups))
    if sum(group.total_byte_size for group in groups) > _MOST_BYTES:
        raise ValueError(f"it becomes more than {_MOST_BYTES / 1e6:g} MB")


def _require_columns(schema: pyarrow.Schema) -> None:
    """Refuse a table without our columns, or with columns of other types."""
    if len(set(schema.names)) < len(schema.names):
        raise ValueError("two of its columns have one name")
    known = {**BEFORE_METRICS, **metric_columns(), "changes": TEXT}
    missing = [name for name in (*BEFORE_METRICS, "changes") if name not in schema.names]
    if missing:
        raise ValueError(f"it has no column {missing[0]}")
    for item in schema:
        if item.type != known.get(item.name, item.type) or item.type not in (
            *KINDS.values(),
            *(WHOLE, pyarrow.bool_()),
        ):
            raise ValueError(f"its column {item.name} is of type {item.type}")


def _require_values(table: pyarrow.Table) -> None:
    """Refuse rows with gaps in required columns, or with values that no plan has."""
    for name, column in zip(table.column_names, table.columns, strict=True):
        if name in _ALWAYS_THERE and column.null_count:
            raise ValueError(f"its column {name} has gaps")
        numbers = column.combine_chunks().flatten() if column.type == NUMBERS else column
        if numbers.type != NUMBER or name.startswith(CHANGE):  # whatever the study varies
            continue
        if pyarrow.compute.all(pyarrow.compute.is_finite(numbers)).as_py() is False:
            raise ValueError(f"its column {name} holds what is no finite number")
    if "id" in table.column_names:
        _require_each(table.column("id"), _ID.fullmatch, "a hash of a case")
    if "planned_by" in table.column_names:
        _require_each(table.column("planned_by"), METHODS.__contains__, "a method")
    if "status" in table.column_names:
        statuses = {one.name.lower() for one in Status}
        if unknown := set(table.column("status").to_pylist()) - statuses:
            raise ValueError(f"its status {min(unknown)!r} is not known")


def _require_each(column: pyarrow.ChunkedArray, is_one: Callable[[str], Any], what: str) -> None:
    for text in set(column.to_pylist()):
        if not is_one(text):
            raise ValueError(f"{quoted(text)} is not {what}")


def _damaged(path: Path, error: Exception) -> InvalidInput:
    words = (str(error) or type(error).__name__).partition("\n")[0]
    reason = printable(words, LONGEST_VALUE)
    allowed = f"it is damaged ({reason}): without it, its cases are planned again"
    return InvalidInput(Status.OUT_OF_RANGE, "file", path, allowed)
