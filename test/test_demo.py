"""The demonstration as a user runs it, in processes of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from ros_processes import DEADLINE, EVENT_TOPIC, RESPONSE_SENT, read_bag

DEMO = "import sys; from ff_planner_ros.ros.demo import run_demo; sys.exit(run_demo())"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Run the demonstration and return where, and the lines it printed."""
    directory = tmp_path_factory.mktemp("a place with: two # traps")
    ended = subprocess.run(
        [sys.executable, "-c", DEMO],
        cwd=directory,
        capture_output=True,
        text=True,
        timeout=3 * DEADLINE,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == ""
    return directory, ended.stdout.splitlines()


def test_both_objectives_reach_the_reference_values(demo: tuple[Path, list[str]]) -> None:
    _, lines = demo
    rows = {line.split()[0]: line.split()[1:] for line in lines if line.startswith("min(")}
    length, attitude = ([float(cell) for cell in rows[name]] for name in ("min(L)", "min(Theta)"))
    assert length[0] <= 1.115
    assert attitude[1] <= 6.0
    for _, _, clearance, solve_time in (length, attitude):
        assert clearance >= 0.0
        assert solve_time > 0.0


def test_the_table_is_aligned(demo: tuple[Path, list[str]]) -> None:
    _, lines = demo
    head = next(index for index, line in enumerate(lines) if line.startswith("objective"))
    assert len({len(line) for line in lines[head : head + 3]}) == 1


def test_the_bag_it_names_holds_every_topic_and_both_answers(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    (bag,) = (line.split(maxsplit=1)[1] for line in lines if line.startswith("bag "))
    messages = read_bag(directory / bag)
    assert set(messages) == {
        "/chaser_state",
        "/obstacles",
        "/joint_trajectory",
        "/predicted_chaser_path",
        "/predicted_chaser_pose",
        EVENT_TOPIC,
    }
    assert all(messages.values()), {topic: len(found) for topic, found in messages.items()}
    assert len(messages["/joint_trajectory"]) == 2
    answers = [e.response[0] for e in messages[EVENT_TOPIC] if e.info.event_type == RESPONSE_SENT]
    assert [answer.status.code for answer in answers[-2:]] == [0, 0]


def test_the_pictures_it_names_are_pictures(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    pictures = [line.split(maxsplit=1)[1] for line in lines if line.startswith("picture ")]
    assert len(pictures) == 5
    for picture in pictures:
        assert (directory / picture).read_bytes().startswith(PNG)


def test_the_scene_it_names_shows_both_plans(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    (scene,) = (line.split(maxsplit=1)[1] for line in lines if line.startswith("scene "))
    page = (directory / scene).read_text(encoding="utf-8")
    assert "min(L), end effector" in page
    assert "min(\\u0398), end effector" in page


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_demonstration_leaves_no_process_behind(
    number: signal.Signals, tmp_path: Path
) -> None:
    demo = subprocess.Popen(
        [sys.executable, "-c", DEMO],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert demo.stdout is not None
    while not demo.stdout.readline().startswith("objective"):
        assert demo.poll() is None
    demo.send_signal(number)
    _, errors = demo.communicate(timeout=DEADLINE)
    assert demo.returncode == 130
    assert errors == "ff-planner demo: interrupted\n"
    # Its processes share its session, which is gone when the last of them is.
    with pytest.raises(ProcessLookupError):
        os.killpg(demo.pid, 0)


FAR_AWAY = """
import sys
from dataclasses import replace
from ff_planner_ros.ros import demo

load = demo.load_scenario

def load_far_away(path):
    problem = load(path)
    return replace(problem, target=replace(problem.target, position=[10.0, 0.0, 0.0]))

demo.load_scenario = load_far_away
sys.exit(demo.run_demo())
"""


def test_a_plan_that_is_not_found_ends_the_demonstration_with_its_cause(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FAR_AWAY]
    ended = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=2 * DEADLINE, check=False
    )
    assert ended.returncode == 3
    assert ended.stderr.startswith("ff-planner demo: target.position is 9.")
    logs = tmp_path / ended.stderr.splitlines()[-1].removeprefix("logs are in ")
    assert "GOAL_OUT_OF_REACH" in (logs / "node.log").read_text()


def test_an_output_directory_that_cannot_be_made_is_bad_input() -> None:
    code = DEMO.replace("run_demo()", "run_demo(Path('/dev/null/out'))")
    command = [sys.executable, "-c", f"from pathlib import Path; {code}"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert ended.returncode == 2
    assert "/dev/null/out" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
