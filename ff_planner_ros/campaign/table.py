"""The tables of a campaign: Parquet files that are only ever added, each written atomically."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet

from ff_planner_ros.analysis.json_file import read_json
from ff_planner_ros.campaign.cases import kind_of
from ff_planner_ros.campaign.part_file import (
    BEFORE_METRICS,
    CHANGE,
    KINDS,
    NUMBER,
    NUMBERS,
    TEXT,
    WHOLE,
    metric_columns,
    part_schema,
    read_part,
)
from ff_planner_ros.campaign.work import Outcome
from ff_planner_ros.common.shown import printable
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.plan import Trajectory

PLANS, TRAJECTORIES = "plans", "trajectories"  # directories of the two tables
_LOCK, _LOCK_MODE = "lock", 0o666
_UNFINISHED = ".unfinished"  # of a file that is being written
# The clock decides it, and so it is the one column that is not the same each time.
CLOCK_COLUMNS = ("solve_time",)
_PART = re.compile(r"part-[0-9]{6,18}\.parquet")
# Of the whole table in memory, where its rows take ten times as much: a million or so.
_MOST_BYTES = 1_000_000_000
_MOST_VERSIONS, _LONGEST = 30, 100  # packages, and characters of what one says


def plan_schema(kinds_of_values: Mapping[str, str]) -> pyarrow.Schema:
    """Return the columns of the table of plans.

    Args:
        kinds_of_values: By varied key, `number`, `numbers` or `text`.
    """
    varied = {f"{CHANGE}{key}": KINDS[kind] for key, kind in kinds_of_values.items()}
    return pyarrow.schema({**BEFORE_METRICS, **metric_columns(), "changes": TEXT, **varied})


def trajectory_schema() -> pyarrow.Schema:
    """Return the columns of the table of trajectories: a row a point."""
    names = [item.name for item in fields(Trajectory)]
    motion = {name: NUMBER if name == "time" else NUMBERS for name in names}
    return pyarrow.schema({"id": TEXT, "point": WHOLE, **motion})


class Writer:
    """Adds rows to the tables of a campaign's directory, which must be `locked`."""

    def __init__(self, directory: Path, schema: pyarrow.Schema) -> None:
        """Read the ids of cases in the table, and remove unfinished files.

        Raises:
            InvalidInput: A file is damaged, or has columns of other types than `schema`.
        """
        self._directory, self._schema = directory, schema
        self._rows: list[dict[str, Any]] = []
        self._points: list[dict[str, Any]] = []
        for name in (PLANS, TRAJECTORIES):
            for unfinished in below(directory, name).glob(f"*{_UNFINISHED}"):
                unfinished.unlink()
        parts = part_files(directory)
        _require_same_kinds([*map(part_schema, parts), schema], directory)
        # Trajectories are written before the rows that make their cases count as done.
        of_plans = {path.name for path in parts}
        for path in (directory / TRAJECTORIES).glob("*.parquet"):
            if path.name not in of_plans:
                path.unlink()
        self.done = set(_column(parts, "id"))
        self._next = 1 + max((int(path.stem.rpartition("-")[2]) for path in parts), default=-1)

    def add(self, outcomes: Sequence[Outcome]) -> int:
        """Queue the rows of cases that are not in the table; return their number."""
        new = 0
        for outcome in outcomes:
            if outcome.row["id"] in self.done:
                continue
            self.done.add(outcome.row["id"])
            self._rows.append({k: self._fitting(k, value) for k, value in outcome.row.items()})
            self._points += outcome.points
            new += 1
        return new

    def _fitting(self, column: str, value: Any) -> Any:
        """Return a value as its column holds it: one that does not fit must not cost other rows.

        A varied value may be of another kind than those that the columns were made for; column
        `changes` has it all the same.
        """
        if not column.startswith(CHANGE) or column not in self._schema.names:
            return value
        wanted = self._schema.field(column).type
        if wanted == TEXT:
            return value if isinstance(value, str) else json.dumps(value)
        return value if wanted == KINDS[kind_of(value)] else None

    @property
    def waiting(self) -> int:
        """Number of queued rows."""
        return len(self._rows)

    def flush(self) -> None:
        """Write the queued rows to new files.

        Raises:
            OSError: They cannot be written; files written before are untouched.
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
        directory = below(self._directory, table)
        directory.mkdir(exist_ok=True)
        unfinished = directory / f"{name}{_UNFINISHED}"
        content = pyarrow.Table.from_pylist(rows, schema=schema)
        try:
            with unfinished.open("xb") as file:
                pyarrow.parquet.write_table(
                    content, file, compression="zstd", write_page_checksum=True
                )
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
    """Hold the lock of a campaign's directory, which is for one writer.

    Raises:
        InvalidInput: Another campaign holds it, or the lock is no plain file.
    """
    path = directory / _LOCK
    if path.is_symlink() or (path.exists() and not path.is_file()):
        allowed = "it must be a file: links are not followed here"
        raise InvalidInput(Status.UNSUPPORTED, _LOCK, path, allowed)
    with open(path, "ab", opener=_no_link) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            allowed = "another campaign is writing to it"
            raise InvalidInput(Status.UNSUPPORTED, "--out", directory, allowed) from None
        yield


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW, _LOCK_MODE)


def below(directory: Path, *names: str) -> Path:
    """Return a path below a campaign's directory; the names may come from untrusted tables.

    Raises:
        InvalidInput: The path would lead out of the directory, or a part of it is a link.
    """
    inside = Path(*names)
    steps = [inside, *inside.parents]
    allowed = ""
    if inside.is_absolute() or ".." in inside.parts or "\0" in str(inside):
        allowed = "it must be a name below it"
    elif any((directory / step).is_symlink() for step in steps if step.parts):
        allowed = "links are not followed here"
    if allowed:
        raise InvalidInput(Status.UNSUPPORTED, f"in {directory}", inside, allowed)
    return directory / inside


def part_files(directory: Path) -> list[Path]:
    """Return the files of the table of plans, in the order in which they were written.

    Raises:
        InvalidInput: A file or the table's directory is a link.
    """
    there = below(directory, PLANS).glob("part-*.parquet")
    names = sorted(path.name for path in there if _PART.fullmatch(path.name))
    return [below(directory, PLANS, name) for name in names]


def read_plans(directory: Path) -> pyarrow.Table:
    """Return the whole table of plans, in the order of the cases' ids.

    Raises:
        InvalidInput: There is no file of it, one is damaged, or all are too large for memory.
    """
    parts = part_files(directory)
    if not parts:
        allowed = "there is no campaign, or it has planned nothing yet"
        raise InvalidInput(Status.OUT_OF_RANGE, "directory", directory, allowed)
    tables, size = [], 0
    for path in parts:
        tables.append(read_part(path))
        size += tables[-1].nbytes
        if size > _MOST_BYTES:
            allowed = f"its table is larger than {_MOST_BYTES / 1e9:g} GB: use pandas or DuckDB"
            raise InvalidInput(Status.UNSUPPORTED, "directory", directory, allowed)
    try:
        return pyarrow.concat_tables(tables, promote_options="permissive").sort_by("id")
    except pyarrow.ArrowException as error:
        allowed = f"its files do not fit together ({str(error).partition(chr(10))[0]})"
        raise InvalidInput(Status.OUT_OF_RANGE, "directory", directory, allowed) from None


def digest_of(table: pyarrow.Table) -> str:
    """Return a hash of a table of plans without its times; it does not depend on the workers."""
    kept = table.drop_columns([name for name in CLOCK_COLUMNS if name in table.column_names])
    found = hashlib.sha256()
    for row in kept.to_pylist():
        found.update(json.dumps(row, sort_keys=True).encode())
    return found.hexdigest()[:16]


def _column(parts: Sequence[Path], name: str) -> Iterator[Any]:
    for path in parts:
        yield from read_part(path, [name]).column(name).to_pylist()


def _require_same_kinds(schemas: list[pyarrow.Schema], directory: Path) -> None:
    try:
        pyarrow.unify_schemas(schemas)
    except pyarrow.ArrowException as error:
        reason = str(error).partition("\n")[0]
        allowed = f"a key is now varied by values of another kind ({reason}): choose another one"
        raise InvalidInput(Status.UNSUPPORTED, "--out", directory, allowed) from None


def require_campaign(directory: Path, expected: Mapping[str, str], file: str) -> None:
    """Create the directory of a campaign, or refuse one of another version.

    Args:
        directory: Created if it is missing.
        expected: Versions of all that the bits of a plan depend on.
        file: Name of the file in the directory that holds the versions.

    Raises:
        InvalidInput: The directory holds something else, or plans of another version.
        OSError: The file cannot be written.
    """
    path = below(directory, file)
    if path.is_file():
        found = read_versions(path)
        if found == expected:
            return
        words = ", ".join(f"{k} {v}" for k, v in found.items())
        allowed = (
            f"its plans are of {words or 'an unknown version'}; this is "
            f"{', '.join(f'{k} {v}' for k, v in expected.items() if found.get(k) != v)}: "
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


def read_versions(path: Path) -> dict[str, str]:
    """Return the versions in a campaign's file; empty if the file is missing or malformed."""
    try:
        found = read_json(path)
    except InvalidInput:
        return {}
    told = found if isinstance(found, dict) and len(found) <= _MOST_VERSIONS else {}
    return {printable(k, _LONGEST): printable(str(v), _LONGEST) for k, v in told.items()}
