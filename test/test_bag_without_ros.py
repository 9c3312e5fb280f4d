"""Bags are read where ROS is not installed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

NODE = Path(__file__).parent / "golden_bags" / "node"
# Everything that a ROS installation brings; the rest of the environment is as it is.
PROGRAM = """
import sys

class WithoutRos:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package.startswith(("rcl", "rosidl")) or package.endswith(("_msgs", "_interfaces")):
            raise ImportError(f"{name} is not installed")

sys.meta_path.insert(0, WithoutRos())
from ff_planner_ros.cli import main
sys.exit(main())
"""


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.law("BAG-10")
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("info", NODE), "5 SOLVED"),
        (("verify", NODE), "verdict: passed"),
        (("recover", NODE, "--output", "saved"), "135 messages were saved"),
        (("export", NODE, "--csv", "tables"), ""),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_bag_is_read_without_ros(
    arguments: tuple[object, ...], said: str, tmp_path: Path
) -> None:
    arguments = tuple(tmp_path / one if one in ("saved", "tables") else one for one in arguments)
    done = run(*arguments)
    # Where the benchmark is installed without Drake, a note says so.
    said_of_engines = r"(ff-planner: note: engine drake .*\n)?"
    assert (done.returncode, re.sub(said_of_engines, "", done.stderr)) == (0, "")
    assert said in done.stdout


@pytest.mark.law("BAG-10")
def test_that_environment_really_has_no_ros() -> None:
    done = run("replay", NODE)
    assert done.returncode == 1
    assert "is not installed" in done.stderr
