"""What a command loads: nothing that it does not use, so that it starts at once.

A search loads none of what takes as long to load as a plan takes: not where it begins, and not
where it comes to guesses, splines, robust margins or phases.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.scenarios import scenario

SCENARIOS = share_directory() / "config" / "scenarios"
CAPTURE = str(SCENARIOS / "lemur_capture.yaml")
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
HEAVY = {"scipy.stats", "scipy.interpolate", "scipy.optimize", "matplotlib"}
ATTITUDE = ("--objective", "attitude")
SPLINES = ("--parametrisation", "joint_spline")
PAPERS = ("--parametrisation", "end_effector_polynomial")


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


@pytest.mark.sampled
@pytest.mark.parametrize("options", [(), ATTITUDE, SPLINES], ids=["", "attitude", "splines"])
@pytest.mark.parametrize(
    "name", ["lemur_capture", "lemur_capture_bodies", "lemur_tumbling", "planar_capture"]
)
def test_no_search_loads_what_takes_as_long_to_load_as_a_plan(
    name: str, options: tuple[str, ...], tmp_path: Path
) -> None:
    loaded = loaded_by("plan", str(SCENARIOS / f"{name}.yaml"), *options, cwd=tmp_path)
    assert "ff_planner_ros.planning.search.planner" in loaded
    assert not loaded & HEAVY


@pytest.mark.parametrize("name", ["whole_capture", "lemur_wheels", "rail_capture", "stow"])
def test_nor_do_phases_wheels_rails_and_goals_of_the_joints(name: str, tmp_path: Path) -> None:
    loaded = loaded_by("plan", str(SCENARIOS / f"{name}.yaml"), cwd=tmp_path)
    assert not loaded & HEAVY


@pytest.mark.parametrize("options", [(), PAPERS], ids=["splines", "the paper's paths"])
def test_nor_do_guesses_after_all_that_the_problem_suggests(
    options: tuple[str, ...], tmp_path: Path
) -> None:
    hard = scenario("cluttered", "lemur", 10, turned=False).problem
    write_scenario(PlanningTask(hard, load_parameters().planner), tmp_path / "hard.yaml")
    loaded = loaded_by("plan", "hard.yaml", *options, cwd=tmp_path)
    assert "numpy.random" in loaded, "these guesses are drawn"
    assert not loaded & HEAVY


def test_nor_do_robust_margins(tmp_path: Path) -> None:
    robust = "{/**: {ros__parameters: {planner: {robust: {sigmas: 3.0, mass: 0.01}}}}}"
    (tmp_path / "robust.yaml").write_text(robust)
    loaded = loaded_by("plan", CAPTURE, "--parameters", "robust.yaml", cwd=tmp_path)
    assert not loaded & HEAVY
