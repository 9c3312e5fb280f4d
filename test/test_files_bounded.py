"""Libraries and tables of plans: bounded, and whole or refused in words."""

import io
import json
import os
import random
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from campaigns import study
from measured_commands import MEGABYTES, SECONDS, Done, Run, measured_commands
from mutants import bytes_mutated
from robots import LEMUR_SCENARIO

from ff_planner_ros.campaign.cases import cases
from ff_planner_ros.campaign.part_file import read_part
from ff_planner_ros.campaign.run import VERSIONS
from ff_planner_ros.campaign.table import Writer, part_files, plan_schema
from ff_planner_ros.campaign.work import Outcome, run_case
from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.library_file import LIBRARY, load_library, save_library
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.library import Library, StoredPlan, kind_and_place
from ff_planner_ros.planning.task.task import PlanningTask, perform

SEED = 20261125
TASK = PlanningTask(load_scenario(LEMUR_SCENARIO), load_parameters().planner)


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    with measured_commands() as run:
        yield run


def require_refused(done: Done, named: str) -> None:
    """One line that names the file, and nothing that takes all time or memory."""
    assert done.code == 2, done
    assert named in done.err, done
    assert done.err.count("\n") == 1, done
    assert done.seconds < SECONDS, done
    assert done.megabytes < MEGABYTES, done


def npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def library(**changes: Any) -> bytes:
    """A file of two plans with three numbers for a place and four for a path."""
    arrays = {"version": np.array(1), "kinds": np.array(["a", "b"])}
    arrays |= {"places": np.ones(6), "places_end": np.array([3, 6])}
    arrays |= {"coefficients": np.ones(8), "coefficients_end": np.array([4, 8])}
    return npz(**(arrays | changes))


def packed(content: bytes, how: int) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", how) as archive, zipfile.ZipFile(io.BytesIO(content)) as old:
        for name in old.namelist():
            archive.writestr(name, old.read(name))
    return stream.getvalue()


def encrypted(content: bytes) -> bytes:
    """Every entry says that it has a password."""
    changed = bytearray(content)
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = changed.find(signature)
        while place >= 0:
            changed[place + flags] |= 1
            place = changed.find(signature, place + 1)
    return bytes(changed)


NO_LIBRARY: dict[str, Callable[[], bytes]] = {
    "640 MB of zeros": lambda: library(places=np.zeros(80_000_000)),
    "a million kinds": lambda: library(
        kinds=np.full(1_000_000, "a"),
        places=np.empty(0),
        places_end=np.zeros(1_000_000, int),
        coefficients=np.empty(0),
        coefficients_end=np.zeros(1_000_000, int),
    ),
    "ends that go back and forth": lambda: library(
        kinds=np.full(10_000, "a"),
        places=np.zeros(100_000),
        places_end=np.tile([0, 100_000], 5_000),
        coefficients=np.empty(0),
        coefficients_end=np.zeros(10_000, int),
    ),
    "ends below zero": lambda: library(places_end=np.array([-3, 6])),
    "ends that are no whole numbers": lambda: library(places_end=np.array([3.0, 6.0])),
    "ends of more plans": lambda: library(places_end=np.array([2, 4, 6])),
    "places that are a table": lambda: library(places=np.ones((2, 3))),
    "places that are texts": lambda: library(places=np.full(6, "1")),
    "a place that is infinite": lambda: library(places=np.full(6, np.inf)),
    "no kinds": lambda: npz(version=np.array(1)),
    "kinds that are numbers": lambda: library(kinds=np.arange(2)),
    "a version that is a list": lambda: library(version=np.array([1, 1])),
    "another compression": lambda: packed(library(), zipfile.ZIP_LZMA),
    "a password": lambda: encrypted(library()),
}


@pytest.mark.sampled
@pytest.mark.law("FILE-01")
@pytest.mark.parametrize("kind", NO_LIBRARY)
def test_a_file_that_is_no_library_is_refused_before_it_takes_time_or_memory(
    kind: str, tmp_path: Path, run: Run
) -> None:
    (tmp_path / LIBRARY).write_bytes(NO_LIBRARY[kind]())
    done = run(["plan", LEMUR_SCENARIO, "--library", tmp_path])
    require_refused(done, f"--library is {tmp_path / LIBRARY}: no library can be read there (")


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_directory(path: Path) -> None:
    path.mkdir()


NO_FILES = {"a pipe": make_pipe, "a device": make_device, "a directory": make_directory}


@pytest.mark.parametrize("kind", NO_FILES)
def test_what_is_no_file_is_refused_as_library_and_as_table(
    kind: str, tmp_path: Path, run: Run
) -> None:
    NO_FILES[kind](tmp_path / LIBRARY)
    require_refused(run(["plan", LEMUR_SCENARIO, "--library", tmp_path]), "library can be read")
    (tmp_path / "plans").mkdir()
    NO_FILES[kind](tmp_path / "plans" / "part-000000.parquet")
    require_refused(run(["campaign", "report", tmp_path]), "part-000000.parquet: ")


def test_a_damaged_library_is_refused_in_words_or_read(
    tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    chance = random.Random(SEED)
    plans = [StoredPlan(kind, np.arange(5.0), np.arange(7.0)) for kind in "abc"]
    whole = save_library(plans, tmp_path).read_bytes()
    for _ in range(times(30, 3000)):
        (tmp_path / LIBRARY).write_bytes(bytes_mutated(whole, chance))
        with suppress(InvalidInput):
            assert all(isinstance(one.kind, str) for one in load_library(tmp_path).plans)


def test_a_library_with_plans_of_unequal_length_fails_no_task(tmp_path: Path) -> None:
    kind, place = kind_and_place(TASK)
    variables = len(perform(TASK).coefficients)
    odd = [
        StoredPlan(kind, place[:-1], np.ones(variables)),
        StoredPlan(kind, np.append(place, 0.0), np.ones(variables)),
        StoredPlan(kind, np.empty(0), np.ones(variables)),
        StoredPlan(kind, 1e100 * np.ones(len(place)), np.ones(variables)),
        StoredPlan(kind, place, np.ones(variables + 1)),
    ]
    save_library(odd, tmp_path)
    assert load_library(tmp_path).first_guess(TASK) is None
    good = StoredPlan(kind, place, np.linspace(0.0, 1.0, variables))
    guess = Library((*odd, good)).first_guess(TASK)
    assert guess is not None
    np.testing.assert_array_equal(guess, good.coefficients)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Rows of the table of a campaign: two plans that are solved, and one that is refused."""
    directory = tmp_path_factory.mktemp("rows")
    grid = {"duration": [2.0, 2.5, -1.0]}
    asked = study(directory, variations={"grid": grid}, methods=[{"name": "ours"}])
    return [run_case(case).row | {"solve_time": 0.5} for case in cases(asked)]


SCHEMA = plan_schema({"duration": "number"})


def table(rows: list[dict[str, Any]], **columns: pyarrow.Array) -> pyarrow.Table:
    """A table with some columns replaced, or one more; their length is that of the rows."""
    made = pyarrow.Table.from_pylist(rows, schema=SCHEMA)
    for name, column in columns.items():
        if name in made.column_names:
            made = made.set_column(made.column_names.index(name), name, column)
        else:
            made = made.append_column(name, column)
    return made


NO_TABLE: dict[str, Callable[[list[dict[str, Any]]], pyarrow.Table]] = {
    "40 MB": lambda rows: table(
        rows, message=pyarrow.array([f"{k}" + "x" * 14_000_000 for k in range(3)])
    ),
    "200,000 rows": lambda rows: table((rows * 66_667)[:200_000]),
    "2,000 columns": lambda rows: table(
        rows, **{f"more_{k}": pyarrow.array([0.0] * len(rows)) for k in range(2_000)}
    ),
    "a status that is not known": lambda rows: table(rows, status=pyarrow.array(3 * ["fine"])),
    "no status": lambda rows: table(rows, status=pyarrow.array(3 * [None], pyarrow.string())),
    "times that are texts": lambda rows: table(rows, solve_time=pyarrow.array(3 * ["soon"])),
    "times that are infinite": lambda rows: table(rows, solve_time=pyarrow.array(3 * [np.inf])),
    "places of infinite numbers": lambda rows: table(rows, place=pyarrow.array(3 * [[np.nan]])),
    "texts that are bytes": lambda rows: table(rows, message=pyarrow.array(3 * [b"\xff"])),
    "lists of lists": lambda rows: table(rows, more=pyarrow.array(3 * [[[1.0]]])),
    "one column": lambda rows: table(rows).select(["id"]),
    "two columns of one name": lambda rows: table(rows).append_column("id", table(rows)["id"]),
}


def written(directory: Path, content: pyarrow.Table) -> Path:
    (directory / "plans").mkdir(exist_ok=True)
    path = directory / "plans" / "part-000000.parquet"
    pyarrow.parquet.write_table(content, path, compression="zstd")
    return path


@pytest.mark.sampled
@pytest.mark.parametrize("kind", NO_TABLE)
def test_a_table_that_is_none_of_ours_is_refused_before_it_takes_time_or_memory(
    kind: str, rows: list[dict[str, Any]], tmp_path: Path, run: Run
) -> None:
    path = written(tmp_path, NO_TABLE[kind](rows))
    require_refused(run(["campaign", "report", tmp_path]), f"file is {path}: it is damaged (")


def test_a_damaged_table_is_refused_in_words_or_read(
    rows: list[dict[str, Any]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    times: Callable[[int, int], int],
) -> None:
    writer = Writer(tmp_path, SCHEMA)
    writer.add([Outcome(row, []) for row in rows])
    writer.flush()
    (path,) = part_files(tmp_path)
    whole, chance = path.read_bytes(), random.Random(SEED)
    for number in range(times(20, 500)):
        path.write_bytes(bytes_mutated(whole, chance))
        code, said = main(["campaign", "report", str(tmp_path)]), capsys.readouterr().err
        assert code in (0, 2), f"mutant {number}: {said}"
        assert not code or f"file is {path}: " in said


def test_a_flipped_bit_of_a_table_that_we_wrote_is_noticed(
    rows: list[dict[str, Any]], tmp_path: Path
) -> None:
    """In what is packed, where it could be another number as well."""
    writer = Writer(tmp_path, SCHEMA)
    writer.add([Outcome(row, []) for row in rows])
    writer.flush()
    (path,) = part_files(tmp_path)
    whole = path.read_bytes()
    column = pyarrow.parquet.ParquetFile(path).metadata.row_group(0).column(0)
    place = column.dictionary_page_offset + column.total_compressed_size // 2
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    with pytest.raises(InvalidInput, match="it is damaged"):
        read_part(path)


VERSIONS_OF = {
    "a pipe": make_pipe,
    "deep lists": lambda path: path.write_text("[" * 100_000),
    "no UTF-8": lambda path: path.write_bytes(b'{"a": "\xff"}'),
    "a list": lambda path: path.write_text("[1]"),
    "40 MB": lambda path: path.write_text(json.dumps({"a": "x" * 39_000_000})),
    "a line break": lambda path: path.write_text(json.dumps({"a\nff-planner: b": "\x1b[31m"})),
}


@pytest.mark.sampled
@pytest.mark.parametrize("kind", VERSIONS_OF)
def test_versions_that_cannot_be_read_are_not_known(
    kind: str, rows: list[dict[str, Any]], tmp_path: Path, run: Run
) -> None:
    written(tmp_path, table(rows))
    VERSIONS_OF[kind](tmp_path / VERSIONS)
    done = run(["campaign", "report", tmp_path])
    assert done.code == 0, done
    assert done.megabytes < MEGABYTES
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert any(words in page for words in ("not known", "a?ff-planner: b ?[31m", "a xxxx"))
