"""The examples as a user runs them, each in a process of its own."""

from __future__ import annotations

import json
import math
import runpy
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from ff_planner_msgs.msg import PlanProgress
from quick_capture import quick_capture, quick_whole_capture
from ros_processes import DEADLINE, private_domain, running_planner

from ff_planner_ros.errors import Status

EXAMPLES = Path(__file__).parents[1] / "examples"
DRIFT = 5  # from the scenario's start to that of a plan, about as with PATIENT [s]
PATIENT = ("-p", "planning_lead_time:=5.0")  # a busy machine takes its time
# What becomes of a plan on a machine so busy that the start is over, or the arm has drifted far.
TOO_SLOW = (Status.TOO_LATE, Status.START_IN_PAST, Status.START_SINGULAR)
BLUNT = ("-p", "tracking.max_position:=0.2")  # what a testbed measures to 2 cm has not moved


@contextmanager
def running_testbed(scenario: Path, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run the testbed; at the end it leaves as it is asked to."""
    command = [sys.executable, str(EXAMPLES / "simulated_testbed.py"), str(scenario), *options]
    process = subprocess.Popen(command)
    try:
        yield process
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE) == 0
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A planner, with nothing else yet."""
    directory = tmp_path_factory.mktemp("world")
    with private_domain(), running_planner(directory, *PATIENT, *BLUNT):
        yield directory


def fly(
    directory: Path, scenario: Path, *options: str, testbed: tuple[str, ...] = ()
) -> tuple[int, dict[str, Any], str]:
    """Run testbed and executive; return the latter's exit code, its report, and what it said.

    Where the machine is too slow for a start as soon as possible, it asks for a later one of a
    testbed that passes through the scenario's start as much later: meanwhile it drifts away.
    """
    file = directory / "report.json"
    command = [sys.executable, str(EXAMPLES / "mission_executive.py"), str(scenario)]
    command += ["--json", str(file)]
    for lead in (0, 20, 60):
        file.unlink(missing_ok=True)
        start = math.ceil(time.time()) + lead
        later = ("--start", str(start)) if lead else ()
        epoch = ("--epoch", str(start - DRIFT)) if lead else ()
        with running_testbed(scenario, *epoch, *testbed):
            ended = subprocess.run(
                [*command, *later, *options],
                capture_output=True,
                text=True,
                timeout=2 * DEADLINE,
                check=False,
            )
        report = json.loads(file.read_text("utf-8"))
        if report["status"] not in TOO_SLOW:
            break
    return ended.returncode, report, ended.stdout + ended.stderr


def test_the_executive_says_at_which_step_the_search_is(capsys: pytest.CaptureFixture[str]) -> None:
    say = runpy.run_path(str(EXAMPLES / "mission_executive.py"))["_say_how_the_search_goes"]
    say(PlanProgress(phase="searching", effort=12, elapsed=0.5))
    say(PlanProgress(phase="refining", effort=70, elapsed=1.5, found=True, best_objective=2.25))
    assert capsys.readouterr().out.splitlines() == [
        "searching   0.50 s, step 12, no path yet",
        "refining    1.50 s, step 70, objective 2.2500",
    ]


@pytest.mark.ci
@pytest.mark.usefixtures("world")
def test_a_capture_is_flown_and_comes_out_as_predicted(tmp_path: Path) -> None:
    scenario = quick_capture(tmp_path)
    code, report, said = fly(tmp_path, scenario)
    assert (code, report["status"]) == (0, Status.SOLVED), said
    # As soon as possible: the chaser drifted in between, at 5 cm/s, and the plan knew.
    assert report["error"]["position"] < 1e-4
    assert report["error"]["angle"] < 1e-4
    assert report["worst_chaser_error"]["position"] < 1e-4
    for word in ("plan", "committed", "predicted", "reached", "deviation"):
        assert any(line.startswith(word) for line in said.splitlines())


@pytest.mark.ci
@pytest.mark.usefixtures("world")
def test_a_body_is_grasped_and_stopped_as_predicted(tmp_path: Path) -> None:
    code, report, said = fly(tmp_path, quick_whole_capture(tmp_path))
    assert code == 0, said
    assert "phase 1    capture, 2.000 s long" in said
    assert "phase 2    at rest" in said
    grasped, stopped = report["phases"]
    assert within(1e-3, 0.1, grasped["error"])
    assert within(5e-3, 0.5, stopped["error"])
    assert within(5e-3, 0.5, stopped["worst_chaser_error"])
    # The body, which would have gone on, is where the end effector holds it.
    for one in (grasped, stopped):
        apart, turned = one["capture"]["position_error"], one["capture"]["orientation_error"]
        assert within(1e-3, 0.1, {"position": apart, "angle": turned})
    assert max(stopped["capture"]["linear_speed"], stopped["capture"]["angular_speed"]) < 1e-3


def within(metres: float, degrees: float, error: dict[str, float]) -> bool:
    return error["position"] < metres and error["angle"] < math.radians(degrees)


@pytest.mark.nightly
@pytest.mark.usefixtures("world")
def test_a_testbed_with_faults_makes_a_difference_that_is_seen(tmp_path: Path) -> None:
    scenario = quick_capture(tmp_path)
    code, report, said = fly(tmp_path, scenario, testbed=("--command-delay", "0.5"))
    assert code == 0, said
    # Half a second late at the end, and carried by the drifting chaser meanwhile.
    assert report["error"]["position"] > 1e-3
    code, report, said = fly(tmp_path, scenario, testbed=("--position-noise", "0.02"))
    assert code == 0, said
    assert report["worst_chaser_error"]["position"] > 0.02


@pytest.mark.nightly
def test_a_planner_in_a_namespace_is_flown_from_there(tmp_path: Path) -> None:
    scenario, names = quick_capture(tmp_path), ("--ros-args", "-r", "__ns:=/chaser_1")
    with private_domain(), running_planner(tmp_path, *names[1:], *PATIENT):
        code, report, said = fly(tmp_path, scenario, *names, testbed=names)
    assert (code, report["status"]) == (0, Status.SOLVED), said


@pytest.mark.ci
@pytest.mark.usefixtures("world")
def test_a_mission_refuses_a_plan_that_turns_the_chaser_too_far(tmp_path: Path) -> None:
    scenario = quick_capture(tmp_path)
    code, report, said = fly(tmp_path, scenario, "--max-attitude-deg", "0.001")
    assert (code, report["status"]) == (3, Status.LIMIT_VIOLATED)
    assert "this mission allows 0.001 deg" in said
    assert "committed" not in said


@pytest.mark.usefixtures("world")
def test_the_planners_refusal_is_the_executives(tmp_path: Path) -> None:
    target = {"position": [10.0, 0.0, 0.0], "euler_xyz_deg": [0.0, 0.0, 0.0]}
    scenario = quick_capture(tmp_path, target=target)
    code, report, said = fly(tmp_path, scenario)
    assert (code, report["status"]) == (3, Status.GOAL_OUT_OF_REACH)
    assert f"refused 300 GOAL_OUT_OF_REACH: {report['message']}" in said


@pytest.mark.ci
def test_the_three_commands_of_the_closed_loop_by_hand_end_with_a_capture(tmp_path: Path) -> None:
    page = (EXAMPLES.parent / "docs" / "how_to" / "operating.md").read_text("utf-8")
    _, _, after = page.partition("The closed loop by hand")
    commands = after.split("```console\n")[1].partition("```")[0].splitlines()
    for name in ("config", "examples"):
        (tmp_path / name).symlink_to(EXAMPLES.parent / name)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    node, testbed, executive = (
        [sys.executable, *words[1:]] if words[0].endswith("python") else words
        for words in map(shlex.split, commands)
    )
    with private_domain(), ExitStack() as stack:
        for command in (node, testbed):
            process = stack.enter_context(
                subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
            )
            stack.callback(process.kill)
            if command is node:
                # Whoever types takes longer: the node is there.
                assert process.stderr is not None
                assert any("ready; recording" in line for line in process.stderr)
        ended = subprocess.run(
            executive, cwd=tmp_path, capture_output=True, text=True, timeout=DEADLINE, check=False
        )
    assert ended.returncode == 0, f"{ended.stdout}{ended.stderr}"
    (off,) = (line.split() for line in ended.stdout.splitlines() if line.startswith("deviation"))
    # The position is measured with noise of 2 mm.
    assert float(off[1]) < 20.0


@pytest.mark.parametrize("example", ["simulated_testbed.py", "mission_executive.py"])
def test_a_scenario_that_is_not_there_is_bad_input(example: str, tmp_path: Path) -> None:
    command = [sys.executable, str(EXAMPLES / example), str(tmp_path / "none.yaml")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert ended.returncode == 2
    assert "none.yaml" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.ci
@pytest.mark.parametrize("example", ["simulated_testbed.py", "mission_executive.py"])
def test_an_option_that_is_misspelt_is_refused(example: str, tmp_path: Path) -> None:
    command = [sys.executable, str(EXAMPLES / example), str(quick_capture(tmp_path)), "--sart=1"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert ended.returncode == 2
    assert "unrecognized arguments: --sart=1" in ended.stderr


@pytest.mark.ci
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_executive_that_waits_in_vain_can_be_interrupted(
    number: signal.Signals, tmp_path: Path
) -> None:
    command = [sys.executable, str(EXAMPLES / "mission_executive.py"), str(quick_capture(tmp_path))]
    with private_domain():
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("asking")
            process.send_signal(number)
            process.communicate(timeout=DEADLINE)
            assert process.returncode == 130
        finally:
            process.kill()
            process.wait()
