"""One screen of what is in a bag; what is wrong with it stands at its end."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from std_msgs.msg import String

from ff_planner_ros.bag.info import info
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.bag.recover import recover
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


def test_every_chunk_that_recover_finds_damaged_is_told_in_the_order_of_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / "run", flush_interval=0.0) as writer:
        for topic in ("/z", "/a"):  # what is first in the file is shown first
            writer.add_topic(topic, "std_msgs/msg/String", [])
        for number in range(9):
            time = START - number * 10**9  # a clock that runs backwards
            writer.write("/z", encode(String(data=f"{number}" * 99)), time, time)
            writer.flush()
    (file,) = (tmp_path / "run").glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    assert len(chunks) == 9
    data, hit = bytearray(file.read_bytes()), [chunks[k] for k in (1, 4, 8)]
    for chunk in hit:
        data[chunk.chunk_start_offset + chunk.chunk_length - 5] ^= 0xFF
    file.write_bytes(data)
    places = [chunk.chunk_start_offset for chunk in hit]

    lines = list(info(tmp_path / "run"))
    assert re.findall(r"note: .* chunk at byte (\d+) is damaged", "\n".join(lines)) == [
        str(place) for place in places
    ]
    shown = "\n".join(lines)
    assert shown.index("  /z ") < shown.index("  /a ")
    assert main(["info", str(tmp_path / "run"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["offset"] for one in told["damaged"]] == places
    assert [topic["name"] for topic in told["topics"]] == ["/z", "/a"]
    notes = recover(tmp_path / "run", tmp_path / "recovered").notes
    assert set(told["notes"]) <= set(notes)
    assert sum("is damaged" in note for note in notes) == len(places)


def test_json_says_what_the_screen_says(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(bag), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["start_ns"], told["end_ns"]) == (START, START + 2 * 10**9)
    assert told["duration_s"] == 2.0
    assert told["message_count"] == 3
    assert told["attached"] == {"robot.urdf": 8}
    assert told["records"]["ff_planner_ros"]["host"] == "rover\x1b[2J"
    assert told["records"]["rosbag2"] == {"dropped": "7"}
    assert (told["request_count"], told["answers"]) == (0, [])
    assert (told["damaged"], told["notes"]) == ([], [])


def test_a_directory_of_bags_is_told_as_such(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(bag, bag.parent / "another")
    (bag.parent / "old").mkdir()
    (bag.parent / "old" / "old_0.db3").touch()
    assert main(["export", "--csv", str(bag.parent / "tables"), str(bag.parent)]) == 2
    said = capsys.readouterr().err
    assert f"{bag.parent} is a directory with 3 bags, another, old, run: name a bag" in said
    assert main(["info", str(bag.parent)]) == 0
    assert f"bags      3 in {bag.parent}, 1 skipped" in capsys.readouterr().out


def test_files_of_several_bags_in_one_directory_are_told(bag: Path) -> None:
    assert not any("by their names" in line for line in info(bag))
    shutil.copy(bag / "run_0.mcap", bag / "rerun_0.mcap")
    assert any("are files of 2 bags, rerun, run: " in line for line in info(bag))
    assert recover(bag, bag.parent / "recovered").is_whole


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
        assert f"reading [{'#' * 10}{'.' * 30}] 1 of 4 MB, 0 min 09 s left" in shown
        assert shown.endswith("\r\033[K")  # what comes after stands on a clean line
