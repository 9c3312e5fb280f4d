"""Where a bag comes from, against what the interpreter, the host and git say themselves."""

from __future__ import annotations

import importlib.metadata
import socket
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import mcap
import numpy as np
import pinocchio
import pytest
import scipy

import ff_planner_ros
from ff_planner_ros.bag import provenance as module
from ff_planner_ros.bag.provenance import provenance


def test_versions_are_those_that_the_packages_have_themselves() -> None:
    known = provenance()
    for name, package in (("numpy", np), ("scipy", scipy), ("pin", pinocchio)):
        assert known[name] == package.__version__
    assert known["mcap"] == importlib.metadata.version("mcap") == mcap.__version__
    assert known["ff_planner_ros"] == known["ff_planner_msgs"]
    assert known["rclpy"].startswith("7.1.")
    assert known["python"] == sys.version.partition(" ")[0]
    assert known["ros_distro"] == "jazzy"


def test_host_and_start_are_told() -> None:
    before = datetime.now(UTC)
    known = provenance(node="/planner", rmw="rmw_x")
    assert known["host"] == socket.gethostname()
    assert "Linux" in known["platform"]
    started = datetime.fromisoformat(known["started"])
    assert -0.001 <= (started - before).total_seconds() < 60.0
    assert known["node"] == "/planner"
    assert known["rmw"] == "rmw_x"
    assert all(isinstance(value, str) and value for value in known.values())


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout that the package seems to lie in."""
    for command in (
        ["init", "-q"],
        ["-c", "user.name=n", "-c", "user.email=e", "commit", "-q", "--allow-empty", "-m", "one"],
        ["tag", "v9"],
    ):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    monkeypatch.setattr(module, "__file__", str(tmp_path / "package" / "bag" / "provenance.py"))
    return tmp_path


def test_a_checkout_is_named_as_git_names_it(checkout: Path) -> None:
    assert provenance()["git"] == "v9"
    (checkout / "file").write_text("new")
    subprocess.run(["git", "-C", str(checkout), "add", "file"], check=True)
    assert provenance()["git"] == "v9-dirty"


def test_what_lies_deeper_in_a_checkout_is_not_of_it(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside = checkout / "venv" / "site-packages" / "bag" / "provenance.py"
    monkeypatch.setattr(module, "__file__", str(inside))
    assert "git" not in provenance()


def test_without_git_nothing_is_said_of_it(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(checkout))
    assert "git" not in provenance()


def test_a_package_that_is_nowhere_known_has_an_unknown_version(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(module._DISTRIBUTIONS, "rclpy", ("no-such-package",))
    assert provenance()["rclpy"] == "unknown"
    assert Path(ff_planner_ros.__file__).is_file()
