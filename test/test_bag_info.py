"""One screen of what is in a bag; what is wrong with it stands at its end."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from std_msgs.msg import String

from ff_planner_ros.bag.encoding import encode
from ff_planner_ros.bag.info import info
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main

START = 1_760_000_000_000_000_000


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    with BagWriter(tmp_path / "run", flush_interval=0.0) as writer:
        writer.add_record("ff_planner_ros", {"ff_planner_ros": "1.2.3", "host": "rover\x1b[2J"})
        writer.custom_data["dropped"] = "7"
        writer.attach("robot.urdf", "application/xml", b"<robot/>")
        writer.add_topic("/text", "std_msgs/msg/String", [])
        writer.add_topic("/silent", "std_msgs/msg/String", [])
        for second in range(3):
            time = START + second * 10**9
            writer.write("/text", encode(String(data="x")), time, time)
    return tmp_path / "run"


def test_it_tells_of_extent_topics_versions_documents_and_losses(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(bag)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["messages", "3"] in lines
    assert ["3", "/text", "std_msgs/msg/String"] in lines
    assert ["0", "/silent", "std_msgs/msg/String"] in lines
    assert ["requests", "0"] in lines
    assert ["ff_planner_ros", "1.2.3"] in lines
    assert ["dropped", "7"] in lines
    assert ["attached", "robot.urdf", "(8", "bytes)"] in lines
    (recorded,) = [line for line in lines if line[0] == "recorded"]
    assert " ".join(recorded[1:]) == (
        "2025-10-09 08:53:20.000 UTC to 2025-10-09 08:53:22.000 UTC, 2.000 s"
    )
    assert not any(line[0] == "note:" for line in lines)


def test_no_control_character_reaches_the_terminal(bag: Path) -> None:
    assert all(line.isprintable() for line in info(bag))
    assert any("rover?[2J" in line for line in info(bag))


def test_what_is_wrong_stands_at_the_end(bag: Path) -> None:
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-9])
    *_, last = info(bag)
    assert last.startswith("note: run_0.mcap: it has no end: its recorder still writes, or was")


def test_what_is_no_bag_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(tmp_path)]) == 2
    assert (
        capsys.readouterr().err
        == f"ff-planner: bag {tmp_path} must hold .mcap files; found: nothing\n"
    )


@pytest.mark.parametrize(("seconds", "is_terminal"), [(1.0, True), (3.0, False), (3.0, True)])
def test_a_bar_is_shown_where_it_takes_long_and_somebody_watches(
    seconds: float,
    is_terminal: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    with progress_bar("reading", total=4_000_000) as progress:
        now += seconds
        progress(1_000_000)
    shown = capsys.readouterr().err
    if seconds < 2.0 or not is_terminal:
        assert shown == ""
    else:
        assert f"reading [{'#' * 10}{'.' * 30}] 1 of 4 MB" in shown
        assert shown.endswith("\r\033[K")  # what comes after stands on a clean line
