"""Where no ROS is installed: what plans, draws, verifies and reads bags runs all the same."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path

import pytest
from quick_capture import quick_capture

from ff_planner_ros.common.share import installation_prefixes, share_directory

CONFIG = share_directory() / "config"
CAPTURE = str(CONFIG / "scenarios" / "lemur_capture.yaml")
LEMUR = str(CONFIG / "robots" / "lemur" / "lemur.urdf")
GOLDEN_BAG = str(Path(__file__).parent / "golden_bags" / "node")
ROS = {"rclpy", "rpyutils", "launch", "launch_ros"} | {
    package.name
    for prefix in installation_prefixes()
    for package in (prefix / "share/ament_index/resource_index/packages").glob("*")
} - {"ff_planner_ros"}

# Without arguments, that of the node.
COMMAND = """
from ff_planner_ros.cli import main, planner_node
sys.exit(main(sys.argv[1:]) if sys.argv[1:] else planner_node())
"""


def python(
    code: str, *arguments: str, cwd: Path, hidden: Collection[str] = ROS
) -> subprocess.CompletedProcess[str]:
    """Run code in a process to which the hidden modules are not there."""
    hide = f"import sys; sys.modules.update(dict.fromkeys({sorted(hidden)}))\n"
    command = [sys.executable, "-c", hide + code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)


def ff_planner(
    *arguments: str, cwd: Path, hidden: Collection[str] = ROS
) -> subprocess.CompletedProcess[str]:
    return python(COMMAND, *arguments, cwd=cwd, hidden=hidden)


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of the capture, made without ROS."""
    directory = tmp_path_factory.mktemp("without_ros")
    done = ff_planner("plan", CAPTURE, "--json", "answer.json", cwd=directory)
    assert done.returncode == 0, done.stderr
    quick_capture(directory, points=13)
    return directory / "answer.json"


def test_the_packages_of_ros_are_really_refused(tmp_path: Path) -> None:
    assert {"rclpy", "ff_planner_msgs", "nav_msgs", "rosidl_parser"} <= ROS
    for package in ("rclpy", "ff_planner_msgs.srv", "nav_msgs.msg"):
        refused = python(f"import {package}", cwd=tmp_path)
        assert "ModuleNotFoundError" in refused.stderr
        assert package.partition(".")[0] in refused.stderr


def test_a_scenario_is_planned(answer: Path) -> None:
    assert json.loads(answer.read_text())["status"] == "solved"


@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        (("robot", LEMUR), "joint_1"),
        (("report", "answer.json"), "answer_report.html"),
        (("verify", "answer.json"), "verdict: passed"),
        pytest.param(("compare", "quick_capture.yaml"), "zero momentum", marks=pytest.mark.ci),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_command_runs(answer: Path, arguments: tuple[str, ...], printed: str) -> None:
    done = ff_planner(*arguments, cwd=answer.parent)
    assert done.returncode == 0, done.stderr
    assert printed in done.stdout


@pytest.mark.sampled
@pytest.mark.law("BAG-10")
@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        (("info", GOLDEN_BAG), "5 SOLVED"),
        (("info", str(Path(GOLDEN_BAG).parent)), "5 solved"),
        (("verify", GOLDEN_BAG), "verdict: passed"),
        # Another processor than the bag's may round otherwise: some are within tolerance there.
        (("replay", GOLDEN_BAG), ", 4 not planned; planning took"),
        (("replay", GOLDEN_BAG, "--set", "planner.starts=1"), "SOLVED > SOLVED"),
        (("report", GOLDEN_BAG, "--output", "bag.html"), "bag.html"),
        (("export", GOLDEN_BAG, "--csv", "tables"), ""),
        (("export", GOLDEN_BAG, "--npz", "plans.npz"), ""),
        (("export", GOLDEN_BAG, "--scenarios", "scenarios"), ""),
        (("recover", GOLDEN_BAG, "--output", "recovered"), "messages were saved"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_bag_is_read(tmp_path: Path, arguments: tuple[str, ...], printed: str) -> None:
    test_a_command_runs(tmp_path / "none", arguments, printed)


@pytest.mark.parametrize("arguments", [(), ("demo",)])
def test_a_command_that_needs_ros_says_in_one_line_what_to_install(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    done = ff_planner(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    program = "ff-planner" if arguments else "planner_node"
    assert re.fullmatch(f"{program}: this command needs ROS 2, .*pip install .*\n", done.stderr)


# As rclpy raises where its libraries are not on the path, as of a ROS that is not sourced.
BROKEN = """
from pathlib import Path
raise ImportError(
    "librcl_action.so: cannot open shared object file: No such file or directory\\nThe C extension "
    "'_rclpy_pybind11.so' failed to be imported while being present on the system."
)
"""


@pytest.mark.parametrize("arguments", [(), ("demo",)])
@pytest.mark.parametrize("fault", ["absent", "broken"])
def test_a_ros_that_is_broken_is_told_as_one_that_is_absent(
    tmp_path: Path, arguments: tuple[str, ...], fault: str
) -> None:
    broken = tmp_path / "rclpy" / "impl"
    broken.mkdir(parents=True)
    (broken.parent / "__init__.py").write_text("from rclpy.impl import implementation_singleton")
    (broken / "__init__.py").write_text("")
    (broken / "implementation_singleton.py").write_text(BROKEN)
    first = f"sys.path.insert(0, {str(tmp_path)!r})\n" if fault == "broken" else ""
    hidden = ROS - {"rclpy"} if fault == "broken" else ROS
    done = python(first + COMMAND, *arguments, cwd=tmp_path, hidden=hidden)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert ": this command needs ROS 2, and " in line
    assert "source a ROS workspace" in line
    assert "rclpy cannot be loaded: librcl_action.so" in line or fault == "absent"


def test_another_module_that_is_missing_is_not_told_as_ros(tmp_path: Path) -> None:
    done = ff_planner("plan", CAPTURE, cwd=tmp_path, hidden={"pinocchio"})
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "this command needs pinocchio: there is no module pinocchio" in line
    assert "ROS" not in line
