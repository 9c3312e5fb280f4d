"""The tables of a campaign: Parquet files that are only ever added, each whole or not there."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet

from ff_planner_ros.campaign.work import Outcome
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Trajectory

PLANS, TRAJECTORIES = "plans", "trajectories"  # directories of the two tables
_LOCK = "lock"
_UNFINISHED = ".unfinished"  # of a file that is being written
# The clock decides it, and so it is the one column that is not the same each time.
CLOCK_COLUMNS = ("solve_time",)

_TEXT, _NUMBER, _WHOLE = pyarrow.string(), pyarrow.float64(), pyarrow.int64()
_NUMBERS = pyarrow.list_(_NUMBER)
_KINDS = {"number": _NUMBER, "numbers": _NUMBERS, "text": _TEXT}
_BEFORE_METRICS = {
    "id": _TEXT,
    "number": _WHOLE,
    "source": _TEXT,
    "method": _TEXT,
    "planned_by": _TEXT,
    "settings": _TEXT,
    "digest": _TEXT,
    "geometry": _TEXT,
    "status": _TEXT,
    "solved": pyarrow.bool_(),
    "message": _TEXT,
    "solve_time": _NUMBER,
    "parametrisation": _TEXT,
    "motion_digest": _TEXT,
    "starts": _WHOLE,
    "iterations": _WHOLE,
    "rollouts": _WHOLE,
    "optimality": _NUMBER,
    "coefficients": _NUMBERS,
    "kind": _TEXT,
    "place": _NUMBERS,
}


def plan_schema(kinds_of_values: Mapping[str, str]) -> pyarrow.Schema:
    """Return the columns of the table of plans.

    Args:
        kinds_of_values: By varied key, `number`, `numbers` or `text`.
    """
    metrics = {}
    for item in fields(Metrics):
        metrics[item.name] = _NUMBER
        if item.name == "peak_joint_torques":
            metrics[item.name] = _NUMBERS
        elif item.name.endswith("_pair"):
            metrics[item.name] = _TEXT
    varied = {f"change.{key}": _KINDS[kind] for key, kind in kinds_of_values.items()}
    return pyarrow.schema({**_BEFORE_METRICS, **metrics, "changes": _TEXT, **varied})


def trajectory_schema() -> pyarrow.Schema:
    """Return the columns of the table of trajectories: a row a point."""
    names = [item.name for item in fields(Trajectory)]
    motion = {name: _NUMBER if name == "time" else _NUMBERS for name in names}
    return pyarrow.schema({"id": _TEXT, "point": _WHOLE, **motion})


class Writer:
    """Adds rows to the tables of a directory; the only one that does at a time."""

    def __init__(self, directory: Path, schema: pyarrow.Schema) -> None:
        """Read which cases are there, and remove what was not finished.

        Raises:
            InvalidInput: A file is damaged, or has columns of other kinds.
        """
        self._directory, self._schema = directory, schema
        self._rows: list[dict[str, Any]] = []
        self._points: list[dict[str, Any]] = []
        for name in (PLANS, TRAJECTORIES):
            for unfinished in (directory / name).glob(f"*{_UNFINISHED}"):
                unfinished.unlink()
        parts = part_files(directory)
        _require_same_kinds([*map(_schema, parts), schema], directory)
        # Trajectories are written before the rows that make their cases count as done.
        of_plans = {path.name for path in parts}
        for path in (directory / TRAJECTORIES).glob("*.parquet"):
            if path.name not in of_plans:
                path.unlink()
        self.done = set(_column(parts, "id"))
        self._next = 1 + max((int(path.stem.rpartition("-")[2]) for path in parts), default=-1)

    def add(self, outcomes: Sequence[Outcome]) -> int:
        """Keep the rows of cases that are not there yet; return how many were not."""
        new = 0
        for outcome in outcomes:
            if outcome.row["id"] in self.done:
                continue
            self.done.add(outcome.row["id"])
            self._rows.append(outcome.row)
            self._points += outcome.points
            new += 1
        return new

    @property
    def waiting(self) -> int:
        """How many rows are not on the disk yet."""
        return len(self._rows)

    def flush(self) -> None:
        """Write what was added to files of its own.

        Raises:
            OSError: They cannot be written; what was written before is untouched.
        """
        if not self._rows:
            return
        name = f"part-{self._next:06d}.parquet"
        if self._points:
            self._write(TRAJECTORIES, name, self._points, trajectory_schema())
        self._write(PLANS, name, self._rows, self._schema)
        self._next += 1
        self._rows, self._points = [], []

    def _write(
        self, table: str, name: str, rows: list[dict[str, Any]], schema: pyarrow.Schema
    ) -> None:
        directory = self._directory / table
        directory.mkdir(exist_ok=True)
        unfinished = directory / f"{name}{_UNFINISHED}"
        content = pyarrow.Table.from_pylist(rows, schema=schema)
        try:
            with unfinished.open("wb") as file:
                pyarrow.parquet.write_table(content, file, compression="zstd")
                file.flush()
                os.fsync(file.fileno())  # a name must never stand for what is not on the disk
            unfinished.replace(directory / name)
        except OSError as error:
            unfinished.unlink(missing_ok=True)
            reason = error.strerror or str(error)
            raise OSError(
                error.errno,
                f"{reason}; the rows of {self._directory / table} written before are kept, and "
                "the same command adds the others",
                str(directory / name),
            ) from None


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Let no other campaign write to a directory meanwhile.

    Raises:
        InvalidInput: One does.
    """
    with (directory / _LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            allowed = "another campaign is writing to it"
            raise InvalidInput(Status.UNSUPPORTED, "--out", directory, allowed) from None
        yield


def part_files(directory: Path, table: str = PLANS) -> list[Path]:
    """Return the files of a table, in the order in which they were written."""
    return sorted((directory / table).glob("part-*.parquet"))


def read_plans(directory: Path) -> pyarrow.Table:
    """Return the whole table of plans, in the order of their ids.

    Raises:
        InvalidInput: A file of it is damaged, or there is none.
    """
    parts = part_files(directory)
    if not parts:
        allowed = "there is no campaign, or it has planned nothing yet"
        raise InvalidInput(Status.OUT_OF_RANGE, "directory", directory, allowed)
    tables = [_read(path) for path in parts]
    return pyarrow.concat_tables(tables, promote_options="permissive").sort_by("id")


def digest_of(table: pyarrow.Table) -> str:
    """Return a hash of all that was planned: the same however many workers planned it."""
    kept = table.drop_columns([name for name in CLOCK_COLUMNS if name in table.column_names])
    found = hashlib.sha256()
    for row in kept.to_pylist():
        found.update(json.dumps(row, sort_keys=True).encode())
    return found.hexdigest()[:16]


def _column(parts: Sequence[Path], name: str) -> Iterator[Any]:
    for path in parts:
        yield from _read(path, [name]).column(name).to_pylist()


def _require_same_kinds(schemas: list[pyarrow.Schema], directory: Path) -> None:
    try:
        pyarrow.unify_schemas(schemas)
    except pyarrow.ArrowException as error:
        reason = str(error).partition("\n")[0]
        allowed = f"a key is now varied by values of another kind ({reason}): choose another one"
        raise InvalidInput(Status.UNSUPPORTED, "--out", directory, allowed) from None


def _schema(path: Path) -> pyarrow.Schema:
    return _opened(path).schema_arrow


def _read(path: Path, columns: list[str] | None = None) -> pyarrow.Table:
    try:
        return _opened(path).read(columns)
    except (pyarrow.ArrowException, OSError) as error:
        raise _damaged(path, error) from None


def _opened(path: Path) -> pyarrow.parquet.ParquetFile:
    try:
        return pyarrow.parquet.ParquetFile(path)
    except (pyarrow.ArrowException, OSError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> InvalidInput:
    reason = str(error).partition("\n")[0]
    allowed = f"it is damaged ({reason}): without it, its cases are planned again"
    return InvalidInput(Status.OUT_OF_RANGE, "file", path, allowed)


def require_campaign(directory: Path, expected: Mapping[str, str], file: str) -> None:
    """Make a directory a campaign's, or refuse one of another version.

    Args:
        directory: Made if it is not there.
        expected: Versions of all that the bits of a plan depend on.
        file: In the directory, that holds them.

    Raises:
        InvalidInput: It holds something else, or plans of another version.
        OSError: It cannot be written.
    """
    path = directory / file
    if path.is_file():
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            found = None
        if found == expected:
            return
        words = ", ".join(f"{k} {v}" for k, v in found.items()) if isinstance(found, dict) else ""
        allowed = (
            f"its plans are of {words or 'an unknown version'}; this is "
            f"{', '.join(f'{k} {v}' for k, v in expected.items() if (found or {}).get(k) != v)}: "
            "choose another directory"
        )
        raise InvalidInput(Status.UNSUPPORTED, "--out", directory, allowed)
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        allowed = "it holds something else: it must be new, empty or of a campaign"
        raise InvalidInput(Status.UNSUPPORTED, "--out", directory, allowed)
    directory.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.name}{_UNFINISHED}")
    unfinished.write_text(json.dumps(dict(expected)) + "\n", encoding="utf-8")
    unfinished.replace(path)
