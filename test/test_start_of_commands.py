"""What a command loads: nothing that it does not use, so that it starts at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ff_planner_ros.common.share import share_directory

CAPTURE = str(share_directory() / "config" / "scenarios" / "lemur_capture.yaml")
GOLDEN_BAG = str(Path(__file__).parent / "golden_bags" / "node")
ANSWER = "answer.json"  # of a plan of the capture
# Runs a command line and prints the names of all modules that were loaded for it, in one last line.
# What would wait for hours, as a console does, is interrupted.
COMMAND = """
import sys, time
from ff_planner_ros.cli import main
wait = time.sleep
def sleep(seconds):
    if seconds > 3600.0:
        raise KeyboardInterrupt
    wait(seconds)
time.sleep = sleep
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print("\\n", *sys.modules)
"""
PAGES = {"matplotlib", "plotly"}
MIDDLEWARE = {"rclpy", "rpyutils"}
ROS = {*MIDDLEWARE, "ff_planner_msgs", "rosidl_parser"}
NUMERICS = {"numpy", "scipy", "pinocchio", "coal", "ff_planner_ros.core.compiled"}
BAGS = {"mcap", "rosbags", "lz4", "zstandard"}


def loaded_by(*arguments: str, cwd: Path) -> set[str]:
    """Run a command in a process of its own, and return what it loaded."""
    command = [sys.executable, "-c", COMMAND, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("arguments", "unused"),
    [
        (("--help",), {*PAGES, *ROS, *NUMERICS, *BAGS, "yaml", "importlib.metadata"}),
        (("plan", "--help"), {*PAGES, *ROS, *NUMERICS, *BAGS, "yaml", "importlib.metadata"}),
        (("plan", CAPTURE), {*PAGES, *ROS, *BAGS, "scipy"}),
        (("info", GOLDEN_BAG), {*PAGES, *ROS, "pinocchio", "coal", "scipy"}),
        (("report", GOLDEN_BAG, "--plans", "0"), {"matplotlib", *MIDDLEWARE}),
        (("report", ANSWER), {"matplotlib", *ROS}),
        (("console", CAPTURE), {"matplotlib", *ROS, "mcap", "scipy", "pyarrow"}),
    ],
    ids=[
        "--help",
        "plan --help",
        "plan",
        "info",
        "report of a bag",
        "report of an answer",
        "console",
    ],
)
def test_a_command_loads_nothing_that_it_does_not_use(
    arguments: tuple[str, ...], unused: set[str], tmp_path: Path
) -> None:
    if ANSWER in arguments:
        loaded_by("plan", CAPTURE, "--json", ANSWER, cwd=tmp_path)
    assert not loaded_by(*arguments, cwd=tmp_path) & unused
