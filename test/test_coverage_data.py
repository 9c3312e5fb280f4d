"""Processes that tests kill leave coverage data as torn as they please, and combining goes on."""

import sqlite3
from pathlib import Path

import pytest
from coverage import CoverageData, CoverageException
from tiers import discard_if_torn


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """Return a file of whole coverage data."""
    file = tmp_path / ".coverage.whole"
    data = CoverageData(str(file))
    data.add_lines({f"module_{number}.py": range(1, 100) for number in range(20)})
    data.close(force=True)
    return file


def combine(file: Path) -> None:
    CoverageData(no_disk=True).update(CoverageData(str(file), read_only=True))


def test_whole_data_stay(written: Path) -> None:
    discard_if_torn(written)
    combine(written)


@pytest.mark.parametrize("column", ["path", "numbits"])
def test_data_with_a_lost_value_go(written: Path, column: str) -> None:
    table = {"path": "file", "numbits": "line_bits"}[column]
    connection = sqlite3.connect(written)
    with connection:
        connection.execute(f"update {table} set {column} = null where rowid = 7")
    connection.close()
    with pytest.raises(CoverageException, match="user-defined"):
        combine(written)
    discard_if_torn(written)
    assert not written.exists()


@pytest.mark.parametrize("kept", [0, 1, 4096, 5000, 20000])
def test_data_that_end_too_soon_go(written: Path, kept: int) -> None:
    written.write_bytes(written.read_bytes()[:kept])
    discard_if_torn(written)
    assert not written.exists()
