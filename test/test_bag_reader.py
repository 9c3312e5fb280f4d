"""The reader: what the writer wrote comes back, and no damage passes for a message."""

from __future__ import annotations

from pathlib import Path

import pytest
from ff_planner_msgs.msg import ChaserState
from std_msgs.msg import String

from ff_planner_ros.bag import reader
from ff_planner_ros.bag.encoding import encode
from ff_planner_ros.bag.reader import read_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError

STRING, STATE = "std_msgs/msg/String", "ff_planner_msgs/msg/ChaserState"
WORDS = tuple(encode(String(data=word * 50)) for word in ("one", "two", "three"))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    directory = tmp_path / "run"
    with BagWriter(directory, flush_interval=0.0) as writer:
        writer.attach("robot.urdf", "application/xml", b"<robot/>")
        writer.attach("parameters.yaml", "application/yaml", b"a: 1")
        for topic, type_name in (("/here", STRING), ("/there", STRING), ("/state", STATE)):
            writer.add_topic(topic, type_name, [])
        for time, (topic, word) in enumerate(zip(("/here", "/there", "/here"), WORDS, strict=True)):
            writer.write(topic, word, time, time)
        writer.write("/state", encode(ChaserState()), 3, 3)
    return directory


def file_of(bag: Path) -> Path:
    return bag / "run_0.mcap"


def test_messages_of_a_type_come_in_order_whatever_their_topic(bag: Path) -> None:
    assert read_bag(bag, STRING).messages == WORDS
    assert read_bag(bag, STATE).messages == (encode(ChaserState()),)
    assert read_bag(bag, "nav_msgs/msg/Path").messages == ()


def test_attachments_come_with_any_type(bag: Path) -> None:
    wanted = {"robot.urdf": b"<robot/>", "parameters.yaml": b"a: 1"}
    assert read_bag(bag, STATE).attachments == wanted


def test_the_file_of_a_bag_is_as_good_as_its_directory(bag: Path) -> None:
    assert read_bag(file_of(bag), STRING) == read_bag(bag, STRING)


def test_a_directory_without_one_file_is_refused(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match=r"empty must hold one \.mcap file; found: none"):
        read_bag(tmp_path / "empty", STRING)
    (bag / "run_1.mcap").write_bytes(b"")
    with pytest.raises(BagError, match=r"found: run_0\.mcap, run_1\.mcap"):
        read_bag(bag, STRING)


def test_a_file_that_is_not_there_or_no_bag_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"none\.mcap cannot be read: No such file"):
        read_bag(tmp_path / "none.mcap", STRING)
    for content in (b"", b"\x89MC", b"text that is no bag"):
        (tmp_path / "other.mcap").write_bytes(content)
        with pytest.raises(BagError, match=r"other\.mcap is no MCAP file"):
            read_bag(tmp_path / "other.mcap", STRING)


def test_a_bag_cut_short_anywhere_says_so(bag: Path) -> None:
    whole = file_of(bag).read_bytes()
    for length in range(9, len(whole) - 1, 97):
        file_of(bag).write_bytes(whole[:length])
        with pytest.raises(BagError, match=r"run_0\.mcap has no end: .*was killed"):
            read_bag(bag, STRING)


def test_no_damage_passes_for_a_message(bag: Path) -> None:
    """Chunks carry a checksum; indexes do not, and without them messages may come in disorder."""
    whole = file_of(bag).read_bytes()
    refusals = []
    for place in range(8, len(whole) - 8, 13):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        file_of(bag).write_bytes(damaged)
        try:
            assert set(read_bag(bag, STRING).messages) <= set(WORDS)
        except BagError as refusal:
            refusals.append(str(refusal))
    assert len(refusals) > 20
    assert all(f"{file_of(bag)} is damaged" in refusal for refusal in refusals)


def test_a_bag_of_another_version_of_the_type_is_refused(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "type_hash", lambda _: "RIHS01_of_another_version")
    with pytest.raises(BagError, match=rf"run_0\.mcap holds another version of {STRING}"):
        read_bag(bag, STRING)
    assert read_bag(bag, "nav_msgs/msg/Path").messages == ()
