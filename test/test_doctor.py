"""`ff-planner doctor`: says what is there, what is missing, and whether it plans."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ff_planner_ros.cli import main
from ff_planner_ros.commands import doctor
from ff_planner_ros.core import compiled

# Hides a module from imports, as if it were not there, and runs the command line.
WITHOUT = """
import sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name in {hidden!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: (
    None if name in {hidden!r} else found(name, package)
)
sys.meta_path.insert(0, Hidden())
from ff_planner_ros.cli import main
sys.exit(main(sys.argv[1:]))
"""


def doctor_without(*hidden: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT.format(hidden=hidden), "doctor"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_whole_installation_plans_and_both_forms_say_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    file = tmp_path / "doctor.json"
    assert main(["doctor", "--json", str(file)]) == 0
    screen, facts = capsys.readouterr().out, json.loads(file.read_text())
    assert facts["version"] == importlib.metadata.version("ff_planner_ros")
    assert facts["dependencies"]["numpy"] == importlib.metadata.version("numpy")
    declared = importlib.metadata.metadata("ff_planner_ros").get_all("Provides-Extra")
    assert set(facts["extras"]) == set(declared or ())
    assert facts["ros"]["ROS_DOMAIN_ID"] == "42"
    assert facts["plan"]["joint_path_length"] == pytest.approx(1.1072, abs=1e-4)
    for told in (facts["version"], facts["ros"]["RMW"], "1.1072 rad in ", "42", facts["core"]):
        assert told in screen


def test_a_missing_extra_comes_with_the_command_that_brings_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    installed = importlib.metadata.version

    def version(name: str) -> str:
        if name in ("pyarrow", "ff_planner_msgs"):
            raise importlib.metadata.PackageNotFoundError(name)
        return installed(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    extras = doctor.findings()["extras"]
    assert extras["campaign"]["missing"] == ["pyarrow"]
    assert extras["campaign"]["command"] == "pip install '.[campaign]'"
    assert extras["ros"]["command"] == "pip install ./msg_defs '.[ros]'"
    assert extras["simulation"]["command"] is None


def test_without_ros_it_plans_and_says_that_there_is_none() -> None:
    done = doctor_without("rclpy", "ff_planner_msgs")
    assert done.returncode == 0, done.stderr
    assert "no module rclpy" in done.stdout


def test_a_core_that_is_missing_is_told_and_no_crash() -> None:
    done = doctor_without("ff_planner_ros.core.compiled")
    assert done.returncode == 2
    assert not done.stderr
    assert "missing: `pip install .` in the sources builds it" in done.stdout
    assert "plan of the capture, min(L)    none: ImportError: " in done.stdout


def test_a_core_older_than_one_of_its_sources_is_told(tmp_path: Path) -> None:
    (tmp_path / "setup.py").touch()
    sources = tmp_path / "ff_planner_ros" / "core"
    sources.mkdir(parents=True)
    built = Path(compiled.__file__)
    header = sources / "arm.hpp"
    header.touch()
    os.utime(tmp_path / "setup.py", (0, 0))
    os.utime(header, (0, 0))
    assert doctor.core(tmp_path) == "built, newer than its sources"
    os.utime(header, (built.stat().st_mtime + 10,) * 2)
    assert doctor.core(tmp_path).startswith("older than arm.hpp: ")
    (tmp_path / "setup.py").unlink()
    assert doctor.core(tmp_path) == "built, installed with its sources"
