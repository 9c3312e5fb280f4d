"""What a command loads: nothing that it does not use, so that it starts at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ff_planner_ros.share import share_directory

CAPTURE = str(share_directory() / "config" / "scenarios" / "lemur_capture.yaml")
GOLDEN_BAG = str(Path(__file__).parent / "golden_bags" / "node")
# Runs a command line and prints the names of all modules that were loaded for it, in one last line.
COMMAND = """
import sys
from ff_planner_ros.cli import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print("\\n", *sys.modules)
"""
PAGES = {"matplotlib", "plotly"}
ROS = {"rclpy", "rpyutils", "ff_planner_msgs", "rosidl_parser"}
NUMERICS = {"numpy", "scipy", "pinocchio", "coal", "piqp", "ff_planner_ros.core.compiled"}
BAGS = {"mcap", "rosbags", "lz4", "zstandard"}
# Half of the time that a plan's imports took; of them only some searches use something.
SOME_SEARCHES = {"scipy.stats", "scipy.interpolate", "scipy.optimize", "scipy.integrate"}


def loaded_by(*arguments: str) -> set[str]:
    """Run a command in a process of its own, and return what it loaded."""
    command = [sys.executable, "-c", COMMAND, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("arguments", "unused"),
    [
        (("--help",), {*PAGES, *ROS, *NUMERICS, *BAGS, "yaml", "importlib.metadata"}),
        (("plan", "--help"), {*PAGES, *ROS, *NUMERICS, *BAGS, "yaml", "importlib.metadata"}),
        (("plan", CAPTURE), {*PAGES, *ROS, *BAGS, *SOME_SEARCHES}),
        (("info", GOLDEN_BAG), {*PAGES, *ROS, "pinocchio", "coal", "piqp", "scipy"}),
    ],
    ids=["--help", "plan --help", "plan", "info"],
)
def test_a_command_loads_nothing_that_it_does_not_use(
    arguments: tuple[str, ...], unused: set[str]
) -> None:
    assert not loaded_by(*arguments) & unused
