"""When `make` remakes `.venv`: where what it is made of differs, and not because of times."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

SOURCE_TREE = Path(__file__).parents[1]
FILES = ("Makefile", "README.md", "constraints.txt", "package.xml", "pyproject.toml", "setup.py")
MESSAGE = "msg_defs/msg/Camera.msg"


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., bool]:
    """Return whether `.venv` stays as it is, by `make`, after a change of a file."""
    for name in FILES:
        shutil.copy(SOURCE_TREE / name, tmp_path)
    shutil.copytree(SOURCE_TREE / "msg_defs", tmp_path / "msg_defs")
    (tmp_path / "benchmark").mkdir()
    shutil.copy(SOURCE_TREE / "benchmark/pyproject.toml", tmp_path / "benchmark")
    for tree in ("config", "examples", "ff_planner_ros", "launch"):
        (tmp_path / tree).symlink_to(SOURCE_TREE / tree)
    python = tmp_path / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    complete = tmp_path / ".venv/complete"

    def make(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = ["make", f"PYTHON={sys.executable}", *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    def is_made(file: str, old: str = "", new: str = "") -> bool:
        path = tmp_path / file
        text = path.read_text("utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1) if old else text, "utf-8")
        told = make(".venv/made_of")
        assert told.returncode == 0, told.stderr
        return make("--question", ".venv/complete").returncode == 0

    complete.touch()
    assert not is_made("setup.py")  # nobody knows of what
    complete.touch()
    return is_made


def test_files_that_were_written_again_remake_nothing(made: Callable[..., bool]) -> None:
    assert all(made(file) for file in ("setup.py", "constraints.txt", MESSAGE))


def test_what_is_no_requirement_remakes_nothing(made: Callable[..., bool]) -> None:
    assert made("pyproject.toml", "line-length = 100", "line-length = 99")
    assert made("setup.py", '"*.css"', '"*.css", "*.svg"')


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("setup.py", "numpy>=1.26,<3", "numpy>=1.27,<3"),
        ("pyproject.toml", "pybind11>=2.13", "pybind11>=2.14"),
        (MESSAGE, "#", "# Another comment. #"),
    ],
)
def test_another_requirement_or_message_remakes_it(
    made: Callable[..., bool], file: str, old: str, new: str
) -> None:
    assert not made(file, old, new)


def test_a_file_that_cannot_be_read_remakes_nothing(made: Callable[..., bool]) -> None:
    with pytest.raises(AssertionError, match="SyntaxError"):
        made("setup.py", "setup(", "setup((")
