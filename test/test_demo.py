"""The demonstration as a user runs it, in processes of its own."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from quick_capture import quick_capture
from ros_processes import DEADLINE, answers_in, read_bag

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import Status
from ff_planner_ros.runs.replay import Verdict, replay, replayable

DEMO = "import sys; from ff_planner_ros.demo.run import run_demo; sys.exit(run_demo())"
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


def rows(lines: list[str], first: str) -> list[list[str]]:
    """The cells of every row of a table whose first cell starts like this."""
    return [line.split() for line in lines if line.startswith(first)]


def plans_found(lines: list[str]) -> int:
    """Number of plans: two that are flown, and any that came too late to commit it."""
    return 2 + sum("was to begin" in line for line in lines)


@pytest.mark.ci
def test_both_objectives_reach_the_reference_values(demo: tuple[Path, list[str]]) -> None:
    """Of the whole robot, with the node's velocity limits: 1.9741 rad and 6.86 deg."""
    _, lines = demo
    (length, attitude) = ([float(cell) for cell in row[1:]] for row in rows(lines, "min("))
    assert length[0] <= 1.99
    assert attitude[1] <= 7.0
    for _, _, clearance, solve_time, *_ in (length, attitude):
        assert clearance >= 0.0
        assert solve_time > 0.0


@pytest.mark.ci
def test_the_end_effector_comes_to_where_the_plan_has_it(demo: tuple[Path, list[str]]) -> None:
    """The goal of the paper's capture, within what the planner may be off and what is printed."""
    _, lines = demo
    for row in rows(lines, "min("):
        off_mm, off_deg = (float(cell) for cell in row[-2:])
        assert off_mm < 0.1
        assert off_deg < 0.01
    goal = [1.7, 0.4, 0.6, -65.0, 80.0, -85.0]
    told = rows(lines, "predicted") + rows(lines, "reached")
    assert [row[1] for row in told] == ["min(L)", "min(Theta)"] * 2
    for row in told:
        found = [float(cell) for cell in row[2:]]
        assert found[:3] == pytest.approx(goal[:3], abs=1.1e-3)
        assert found[3:] == pytest.approx(goal[3:], abs=0.1)


@pytest.mark.ci
def test_the_tables_are_aligned(demo: tuple[Path, list[str]]) -> None:
    _, lines = demo
    first, second = (
        index for index, line in enumerate(lines) if line.lstrip().startswith("objective")
    )
    assert len({len(line) for line in lines[first : first + 3]}) == 1
    assert len({len(line) for line in lines[second : second + 5]}) == 1


@pytest.mark.ci
def test_the_bag_it_names_holds_every_topic_and_both_answers(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    (bag,) = (line.split(maxsplit=1)[1] for line in lines if line.startswith("bag "))
    messages = read_bag(directory / bag)
    for topic in ("joint_trajectory", "predicted_chaser_path"):
        assert len(messages[f"/{topic}"]) == 2, topic
    assert len(messages["/markers"]) == 4  # each plan waits, and is published
    # Of every testbed that a plan was found for. One whose flight was refused at once is stopped
    # before the recorder has found it, or after.
    assert plans_found(lines) <= len(messages["/obstacles"]) <= len(rows(lines, "flying"))
    for topic in ("chaser_state", "predicted_chaser_pose", "tracking_error", "diagnostics"):
        assert len(messages[f"/{topic}"]) > 10, topic
    # The executive asks again until the planner has heard of the new flight.
    codes = [answer.status.code for answer in answers_in(messages)]
    # A machine that is too slow for it is given a later start.
    not_yet = {Status.NO_STATE, Status.NO_OBSTACLES, Status.STATE_TOO_OLD}
    not_yet |= {Status.TOO_LATE, Status.START_IN_PAST}
    assert set(codes) <= {Status.SOLVED} | not_yet
    assert codes.count(Status.SOLVED) == plans_found(lines)
    assert codes[-1] == Status.SOLVED


@pytest.mark.law("BAG-02")
@pytest.mark.ci
def test_its_bag_alone_gives_the_same_plans_again(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    (bag,) = (line.split(maxsplit=1)[1] for line in lines if line.startswith("bag "))
    with open_bag(directory / bag) as opened:
        replayed = [replay(one) for one in replayable(opened)]
    verdicts = [one.verdict for one in replayed if one.exchange.status is Status.SOLVED]
    assert verdicts == [Verdict.IDENTICAL] * plans_found(lines)


@pytest.mark.ci
def test_the_pictures_it_names_are_pictures(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    pictures = [line.split(maxsplit=1)[1] for line in lines if line.startswith("picture ")]
    assert len(pictures) == 7
    for picture in pictures:
        assert (directory / picture).read_bytes().startswith(PNG)


@pytest.mark.ci
def test_the_scene_it_names_shows_both_plans(demo: tuple[Path, list[str]]) -> None:
    directory, lines = demo
    (scene,) = (line.split(maxsplit=1)[1] for line in lines if line.startswith("scene "))
    page = (directory / scene).read_text(encoding="utf-8")
    assert "min(L), end effector" in page
    assert "min(\\u0398), end effector" in page


@pytest.mark.ci
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
    while not demo.stdout.readline().startswith("flying"):
        assert demo.poll() is None
    demo.send_signal(number)
    _, errors = demo.communicate(timeout=DEADLINE)
    assert demo.returncode == 130
    assert errors == "ff-planner demo: interrupted\n"
    # Its processes share its session, which is gone when the last of them is.
    with pytest.raises(ProcessLookupError):
        os.killpg(demo.pid, 0)


def run_with(scenario: Path, before: str = "") -> subprocess.CompletedProcess[str]:
    """Run the demonstration of another scenario, beside which its output is put."""
    code = f"""
import sys
from pathlib import Path
from ff_planner_ros.demo import flights, run as demo

{before}
sys.exit(demo.run_demo(scenario=Path({str(scenario)!r})))
"""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=scenario.parent,
        capture_output=True,
        text=True,
        timeout=3 * DEADLINE,
        check=False,
    )


@pytest.mark.ci
def test_a_plan_that_is_not_found_ends_the_demonstration_with_its_cause(tmp_path: Path) -> None:
    target = {"position": [10.0, 0.0, 0.0], "euler_xyz_deg": [0.0, 0.0, 0.0]}
    ended = run_with(quick_capture(tmp_path, target=target))
    assert ended.returncode == 3
    assert ended.stderr.startswith("ff-planner demo: target.position is 9.")
    logs = tmp_path / ended.stderr.splitlines()[-1].removeprefix("logs are in ")
    assert (logs / "node.log").is_file()


@pytest.mark.ci
def test_every_flight_begins_after_twice_the_time_that_its_plan_was_measured_to_take(
    demo: tuple[Path, list[str]],
) -> None:
    _, lines = demo
    (told,) = (line for line in lines if line.startswith("planned on trial"))
    *planning, starting = (float(number) for number in re.findall(r"([0-9.]+) s\b", told))
    leads = [float(row[-2]) for row in rows(lines, "flying")]
    assert len(planning) == 2
    for took, lead in zip(planning, leads[:2], strict=False):  # a slow machine flies once more
        expected = 1.5 * (took + starting)
        assert expected - 0.13 <= lead <= expected + 1.13  # as printed, and in whole seconds


@pytest.mark.nightly
def test_a_flight_that_comes_too_late_is_flown_again_with_twice_the_lead(tmp_path: Path) -> None:
    # The first lead is too short for any machine; what it draws in the end is no matter here.
    hurry = """
demo.save_figures, demo.save_scene = lambda *_: [], lambda *_: None
run_example = flights._run_example
def hurried(name, flight, stage, lead):
    return run_example(name, flight, stage, 0 if name == "length" else lead)
flights._run_example = hurried
"""
    ended = run_with(quick_capture(tmp_path), before=hurry)
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert rows(lines, "too late, later once more")
    first, second, *_ = [float(row[-2]) for row in rows(lines, "flying")]
    assert 2.0 * (first - 1.0) <= second <= 2.0 * first
    for row in rows(lines, "min("):
        assert float(row[-2]) < 0.1


@pytest.mark.ci
def test_an_output_directory_that_cannot_be_made_is_bad_input() -> None:
    code = DEMO.replace("run_demo()", "run_demo(Path('/dev/null/out'))")
    command = [sys.executable, "-c", f"from pathlib import Path; {code}"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert ended.returncode == 2
    assert "/dev/null/out" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


def flown(directory: Path, *arguments: str) -> list[str]:
    """Fly another scene from the command line, and return what it prints."""
    ended = subprocess.run(
        [sys.executable, "-m", "ff_planner_ros.cli", "demo", *arguments],
        cwd=directory,
        capture_output=True,
        text=True,
        timeout=3 * DEADLINE,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines()


@pytest.mark.nightly
def test_a_body_that_tumbles_is_captured_in_real_time(tmp_path: Path) -> None:
    lines = flown(tmp_path, "--testbed", "tumbling")
    captured = [row for row in rows(lines, "min(") if len(row) == 6]
    given, chosen = (float(row[1]) for row in captured)
    assert given == 12.0
    assert 8.0 <= chosen < 12.0
    for row in captured:
        apart_mm, turned_deg, moving_mm_s, turning_deg_s = (float(cell) for cell in row[2:])
        assert max(apart_mm, moving_mm_s) < 1.0
        assert max(turned_deg, turning_deg_s) < 0.05
    (picture,) = tmp_path.glob("demo_output/*/relative_motion.png")
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.nightly
def test_a_capture_on_a_table_is_flown_and_seen_from_above(tmp_path: Path) -> None:
    lines = flown(tmp_path, "--testbed", "planar")
    flights = rows(lines, "min(")
    assert len(flights) == 2
    for _, _, _, _, _, off, turned in flights:
        assert float(off) < 1.0
        assert float(turned) < 0.05
    (picture,) = tmp_path.glob("demo_output/*/from_above.png")
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.nightly
def test_a_plan_made_again_on_the_way_reaches_what_open_loop_misses(tmp_path: Path) -> None:
    lines = flown(tmp_path, "--testbed", "following")
    table = lines[lines.index("Planned again on the way") + 2 :][:3]
    torques_alone, open_loop, replanned = (line.split() for line in table)
    assert float(torques_alone[-1]) >= 40.0
    assert 5.0 <= float(open_loop[-1]) < 40.0
    assert float(replanned[-1]) <= 5.0
    assert int(replanned[4]) >= 1  # plans
    (picture,) = tmp_path.glob("demo_output/*/following.png")
    assert picture.read_bytes().startswith(PNG)
