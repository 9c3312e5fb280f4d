"""`ff-planner verify` as a user types it, on all that it takes."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from quick_capture import resting_capture
from robots import CANADARM2_SCENARIO, LEMUR_SCENARIO
from ros_processes import Scene, connected_client, private_domain, running_planner

from ff_planner_ros.cli import main
from ff_planner_ros.errors import Status

CAPTURE = str(LEMUR_SCENARIO)


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with answer.json and answer_bag, of one plan."""
    directory = tmp_path_factory.mktemp("answers")
    files = ("--json", str(directory / "answer.json"), "--bag", str(directory / "answer_bag"))
    assert main(["plan", CAPTURE, *files]) == 0
    return directory


def test_a_scenario_is_planned_and_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", CAPTURE]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"lemur_capture.yaml, open loop in MuJoCo \d", shown)
    assert re.search(r"off the plan +0\.000\d +0\.0000 +0\.0000 +0\.0000 +\d\.\de-\d\d\n", shown)
    assert re.search(r"allowed +1\.0000 +0\.0500 +1\.0000 +0\.0500 +1\.0e-06\n", shown)
    assert re.search(r"contacts: none of \d+ pairs of lines and obstacles\n", shown)
    assert "verdict: passed" in shown


@pytest.mark.sampled
@pytest.mark.law("PLAN-22")
@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param((CAPTURE, "--objective", "attitude"), marks=pytest.mark.ci),
        (CAPTURE, "--method", "apf"),
        (str(CANADARM2_SCENARIO),),
        pytest.param((str(CANADARM2_SCENARIO), "--objective", "attitude"), marks=pytest.mark.ci),
    ],
    ids=["attitude", "apf", "canadarm2", "canadarm2 attitude"],
)
def test_other_plans_pass_too(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", *arguments]) == 0
    assert "verdict: passed" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["answer.json", "answer_bag", "answer_bag/answer_bag_0.mcap"])
def test_an_answer_that_was_written_passes(
    answers: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(answers / name)]) == 0
    assert "verdict: passed" in capsys.readouterr().out


def test_an_answer_is_verified_without_the_files_that_it_came_from(
    answers: Path, tmp_path: Path
) -> None:
    """In another directory, in a process that has no ROS."""
    shutil.copy(answers / "answer.json", tmp_path)
    code = (
        "import sys; sys.modules['rclpy'] = sys.modules['ff_planner_msgs'] = None\n"
        "from ff_planner_ros.cli import main\n"
        "sys.exit(main(['verify', 'answer.json']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_a_plan_that_does_not_come_true_ends_with_3(
    answers: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = json.loads((answers / "answer.json").read_text())
    for row in answer["joint_torques"]:
        row[3] *= 1.02
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(answer))
    assert main(["verify", str(wrong)]) == 3
    assert "failed: the system does not do what the plan says" in capsys.readouterr().out


def test_a_motion_beyond_all_bounds_is_told_apart_and_leaves_no_file_behind(
    answers: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = json.loads((answers / "answer.json").read_text())
    for row in answer["joint_torques"]:
        row[:] = [1e4 * torque for torque in row]
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(answer))
    monkeypatch.chdir(tmp_path)
    assert main(["verify", "wrong.json"]) == 3
    assert "failed: the momentum changes" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == [wrong]  # MuJoCo would write its log here


@pytest.mark.nightly  # in CI the page of verification.md has this table
def test_sensitivity_adds_a_table(answers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(answers / "answer.json"), "--sensitivity"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"\nnothing +0\.00 +0\.00 +0\.00 +0\.00\n", shown)
    assert re.search(r"\nchaser 1 mm/s off at the start +10\.00 +0\.00 +10\.00 +0\.00\n", shown)


def test_a_scenario_without_a_plan_ends_with_3(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", CAPTURE, "--method", "straight"]) == 3
    assert "inside obstacle c1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("notes.txt", b"", r"notes\.txt: it must be a scenario \(\.yaml\), an answer \(\.json\)"),
        ("answer.json", b"{", r"answer\.json: it is not JSON"),
        ("answer.json", b"\xff", r"answer\.json: it is not UTF-8"),
        ("answer.json", b"{}", r"answer\.json: status is missing"),
        ("run.mcap", b"text", r"run\.mcap is no MCAP file"),
        ("scenario.yaml", b"{}", "robot is missing"),
    ],
)
def test_what_cannot_be_read_ends_with_2_and_what_is_wrong(
    name: str, content: bytes, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert main(["verify", str(tmp_path / name)]) == 2
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize("name", ["none.yaml", "none.json", "none.mcap", "none"])
def test_what_is_not_there_ends_with_2_and_its_name(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(tmp_path / name)]) == 2
    assert name in capsys.readouterr().err


@pytest.fixture(scope="module")
def bag_of_the_node(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Path]:
    """Two plans and, between them, a refusal, recorded by a planner process."""
    scene, directory = Scene(resting_capture()), tmp_path_factory.mktemp("node")
    patient = ("-p", "planning_lead_time:=60.0")
    with private_domain(), running_planner(directory, *patient) as planner:
        with connected_client() as client:
            client.wait_for_planner()
            refused = scene.complete_request()
            refused.duration = -1.0
            codes = [
                client.plan(request).status.code
                for request in (scene.complete_request(), refused, scene.complete_request())
            ]
        planner.stop()
        assert codes == [Status.SOLVED, Status.OUT_OF_RANGE, Status.SOLVED]
        yield planner.bag


@pytest.mark.ci
def test_every_plan_that_the_node_recorded_passes(
    bag_of_the_node: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(bag_of_the_node)]) == 0
    shown = capsys.readouterr().out
    assert re.findall(r"\.(\d), open loop", shown) == ["1", "3"]
    assert shown.count("verdict: passed") == 2


@pytest.mark.ci
def test_a_bag_without_plans_is_refused_and_that_its_node_still_runs_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with private_domain(), running_planner(tmp_path) as planner:
        with connected_client() as client:
            client.wait_for_planner()
        assert main(["verify", str(planner.bag)]) == 2
    assert "its recorder still writes, or was killed" in capsys.readouterr().err
