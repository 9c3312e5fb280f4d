"""What a run of the tests closes with."""

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = """
import pytest

def test_today(): pass
def test_today_too(): pass
@pytest.mark.skip
def test_elsewhere(): pass
@pytest.mark.ci
def test_in_ci(): pass
@pytest.mark.nightly
@pytest.mark.parametrize("number", [1, 2, 3])
def test_at_night(number): pass
"""


@pytest.mark.parametrize("workers", ["0", "2"])
def test_it_closes_with_what_ran_and_what_the_longer_tiers_hold(
    workers: str, tmp_path: Path
) -> None:
    (tmp_path / "test_made_up.py").write_text(TESTS)
    here = Path(__file__).parent
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {here} {here.parent}/tools\n")
    command = [sys.executable, "-m", "pytest", "-ptiers", "-pno:cacheprovider", f"-n{workers}"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    heading, told, *longer = ran.stdout.splitlines()[-4:]
    assert heading.strip("= ") == "tier everyday"
    assert told.startswith("2 passed, 1 skipped, 0 failed, 0 error in ")
    assert sorted(longer) == [
        "1 tests more run with --tier ci",
        "3 tests more run with --tier nightly",
    ]
