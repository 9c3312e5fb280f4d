"""Recover: what a damaged bag still holds comes into a new one, and what is lost is told."""

from __future__ import annotations

import random
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from evil_bags import CHUNK, MESSAGE, whole_records
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbag2_format import check_bag
from rosbags.highlevel import AnyReader
from std_msgs.msg import String

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.recover import RECORD, Recovery, recover
from ff_planner_ros.bag.writer import BagWriter, QualityOfService
from ff_planner_ros.cli import main
from ff_planner_ros.errors import BagError

STRING = "std_msgs/msg/String"
MESSAGES = [(f"/topic_{number % 2}", encode(String(data=f"{number}"))) for number in range(10)]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    directory = tmp_path / "run"
    with BagWriter(directory, flush_interval=0.0) as writer:
        writer.custom_data["dropped"] = "3"
        writer.attach("robot.urdf", "application/xml", b"<robot/>")
        for topic in ("/topic_0", "/topic_1", "/silent"):
            writer.add_topic(topic, STRING, [QualityOfService(durability="transient_local")])
        for time, (topic, cdr) in enumerate(MESSAGES):
            writer.write(topic, cdr, time, time)
            writer.flush()  # a chunk of its own
    return directory


def file_of(bag: Path) -> Path:
    return bag / "run_0.mcap"


def read_by_rosbags(bag: Path) -> list[tuple[str, bytes]]:
    with AnyReader([bag]) as reader:
        return [(connection.topic, data) for connection, _, data in reader.messages()]


def chunks(file: Path) -> list[tuple[int, int]]:
    """Offset and length of each chunk, by the index."""
    with file.open("rb") as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    return [(index.chunk_start_offset, index.chunk_length) for index in indexes]


def saved(recovery: Recovery) -> int:
    return sum(recovery.saved.values())


def test_a_whole_bag_is_saved_whole(bag: Path, tmp_path: Path) -> None:
    before = {file: file.read_bytes() for file in bag.iterdir()}
    recovery = recover(bag, tmp_path / "new")
    check_bag(tmp_path / "new")
    assert recovery == Recovery({"/silent": 0, "/topic_0": 5, "/topic_1": 5}, {}, True, ())
    assert read_by_rosbags(tmp_path / "new") == MESSAGES
    assert {file: file.read_bytes() for file in bag.iterdir()} == before


def test_the_new_bag_has_the_layout_topics_and_documents_of_the_old(
    bag: Path, tmp_path: Path
) -> None:
    recover(bag, tmp_path / "new")
    with open_bag(bag) as old, open_bag(tmp_path / "new") as new:
        assert new.topics == old.topics
        assert new.attachments == old.attachments
        assert new.notes == ()
    old_metadata, new_metadata = (
        yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        for directory in (bag, tmp_path / "new")
    )
    assert old_metadata["topics_with_message_count"] == new_metadata["topics_with_message_count"]
    assert new_metadata["relative_file_paths"] == ["new_0.mcap"]
    assert new_metadata["custom_data"] == {"dropped": "3", "recovered_from": "run_0.mcap"}


@pytest.mark.law("BAG-06")
def test_cut_anywhere_all_messages_of_whole_chunks_are_saved(bag: Path, tmp_path: Path) -> None:
    whole, found = file_of(bag).read_bytes(), chunks(file_of(bag))
    first, (last, last_length) = found[0][0], found[-1]
    places = random.Random(6).sample(range(first, last + last_length), 25)
    for place in places:
        file_of(bag).write_bytes(whole[:place])
        complete = sum(offset + length <= place for offset, length in found)
        new = tmp_path / f"new_{place}"
        recovery = recover(bag, new)
        assert "it has no end" in recovery.notes[0]
        assert saved(recovery) == complete
        assert new.exists() == (complete > 0)
        if complete:
            check_bag(new)
            assert read_by_rosbags(new) == MESSAGES[:complete]
            with open_bag(new) as opened:
                assert opened.attachments == {"robot.urdf": b"<robot/>"}
                assert set(recovery.notes) <= set(opened.metadata[RECORD].values())


@pytest.mark.law("BAG-06")
@pytest.mark.parametrize("use_chunking", [True, False])
def test_cut_at_any_byte_of_its_end_all_whole_messages_are_saved(
    tmp_path: Path, use_chunking: bool
) -> None:
    file, new = tmp_path / "run.mcap", tmp_path / "new"
    copied(file, CompressionType.ZSTD, use_chunking)
    whole, holds = file.read_bytes(), CHUNK if use_chunking else MESSAGE
    ends = [end for opcode, end in whole_records(whole) if opcode == holds]
    assert len(ends) == len(MESSAGES)
    for place in (*range(ends[-3], ends[-1] + 40), *range(0, len(whole), 20)):
        file.write_bytes(whole[:place])
        complete = [topic for (topic, _), end in zip(MESSAGES, ends, strict=True) if end <= place]
        saved = recover(file, new).saved
        assert {topic: count for topic, count in saved.items() if count} == Counter(complete), place
        shutil.rmtree(new, ignore_errors=True)


@pytest.mark.law("BAG-06")
@pytest.mark.parametrize("compression", CompressionType)
def test_whatever_is_cut_or_damaged_every_whole_chunk_is_saved_and_the_exit_code_tells(
    tmp_path: Path, compression: CompressionType, times: Callable[[int, int], int]
) -> None:
    file, new, chance = tmp_path / "run.mcap", tmp_path / "new", random.Random(63)
    copied(file, compression)
    whole, found = file.read_bytes(), chunks(file)
    for number in range(times(130, 400)):
        place, is_cut = chance.randrange(len(whole)), number % 2 == 0
        hit = whole[place] ^ chance.randrange(1, 256)
        data = whole[:place] if is_cut else whole[:place] + bytes([hit]) + whole[place + 1 :]
        file.write_bytes(data)
        kept = [
            message
            for message, (offset, length) in zip(MESSAGES, found, strict=True)
            if data[offset : offset + length] == whole[offset : offset + length]
        ]
        code = main(["recover", str(file), "--output", str(new)])
        read = read_by_rosbags(new) if new.exists() else []
        shutil.rmtree(new, ignore_errors=True)
        told = f"{number}: byte {place}, {'cut' if is_cut else hit}"
        assert [message for message in read if message in MESSAGES] == read, told
        if is_cut or place >= 8:
            assert [message for message in read if message in kept] == kept, told
        if not is_cut:
            assert (code == 0) == (read == MESSAGES), told
        assert (code == 1) == (read == []), told
        assert code in (0, 1, 3), told


def test_without_its_index_alone_everything_is_saved(bag: Path, tmp_path: Path) -> None:
    whole, (offset, length) = file_of(bag).read_bytes(), chunks(file_of(bag))[-1]
    file_of(bag).write_bytes(whole[: offset + length])
    recovery = recover(bag, tmp_path / "new")
    assert recovery.is_whole
    assert saved(recovery) == len(MESSAGES)


@pytest.mark.law("BAG-06")
def test_a_damaged_chunk_is_left_out_and_counted(bag: Path, tmp_path: Path) -> None:
    whole, found = bytearray(file_of(bag).read_bytes()), chunks(file_of(bag))
    offset, length = found[4]
    whole[offset + length - 5] ^= 0xFF
    file_of(bag).write_bytes(whole)
    recovery = recover(bag, tmp_path / "new")
    assert not recovery.is_whole
    assert recovery.lost == {"/topic_0": 1}
    assert f"the chunk at byte {offset} is damaged" in recovery.notes[0]
    assert read_by_rosbags(tmp_path / "new") == MESSAGES[:4] + MESSAGES[5:]


@pytest.mark.parametrize(
    "damage",
    [bytes(9), b"\x06" + b"\xff" * 8, b"\x77" + b"\x7f" * 8, b"\x86", b"\x06\x01", b"\x06\xff"],
)
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE])
def test_without_an_index_what_comes_after_the_damage_is_found_again(
    tmp_path: Path, damage: bytes, compression: CompressionType
) -> None:
    """As if a page of the disk were lost in a recording that was killed, or a length changed."""
    file = tmp_path / "run.mcap"
    copied(file, compression)
    whole, found = bytearray(file.read_bytes()[:-9]), chunks(file)
    offset, _ = found[4]
    whole[offset : offset + len(damage)] = damage
    file.write_bytes(whole)
    recovery = recover(file, tmp_path / "new")
    assert not recovery.is_whole
    assert f" at byte {offset} " in recovery.notes[1] or f"from byte {offset} " in recovery.notes[1]
    assert read_by_rosbags(tmp_path / "new") == MESSAGES[:4] + MESSAGES[5:]


def copied(file: Path, compression: CompressionType, use_chunking: bool = True) -> None:
    """Write the messages into a file, with a chunk for each or without chunks."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=1, compression=compression, use_chunking=use_chunking)
        writer.start("ros2", "test")
        schema = writer.register_schema(STRING, "ros2msg", b"string data\n")
        numbers = [writer.register_channel(f"/topic_{k}", "cdr", schema) for k in range(2)]
        for time, (topic, cdr) in enumerate(MESSAGES):
            writer.add_message(numbers[topic == "/topic_1"], time, cdr, time)
        writer.finish()


@pytest.mark.law("BAG-07")
def test_a_chunk_with_a_wrong_checksum_is_left_out_whole(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    copied(file, CompressionType.NONE)
    file.write_bytes(file.read_bytes().replace(MESSAGES[4][1], MESSAGES[5][1]))
    recovery = recover(file, tmp_path / "new")
    assert (saved(recovery), recovery.lost) == (9, {"/topic_0": 1})


def test_every_file_of_a_split_bag_is_saved(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    with BagWriter(bag, flush_interval=0.0) as writer:
        writer.add_topic("/topic_0", STRING, [])
        for time in range(6):
            if time in (2, 4):
                writer.split()
            writer.write("/topic_0", MESSAGES[time][1], time, time)
    last = bag / "run_2.mcap"
    last.write_bytes(last.read_bytes()[:-9])
    (bag / "run_1.mcap").write_bytes(b"")
    recovery = recover(bag, tmp_path / "new")
    assert not recovery.is_whole
    assert any("run_1.mcap: it is empty" in note for note in recovery.notes)
    check_bag(tmp_path / "new")
    assert [data for _, data in read_by_rosbags(tmp_path / "new")] == [
        MESSAGES[time][1] for time in (0, 1, 4, 5)
    ]


@pytest.mark.law("BAG-09")
def test_nothing_is_overwritten(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    with pytest.raises(BagError, match="new exists already"):
        recover(bag, tmp_path / "new")
    (tmp_path / "other.partial").mkdir()
    with pytest.raises(BagError, match=r"other\.partial is in the way"):
        recover(bag, tmp_path / "other")
    with pytest.raises(BagError, match="cannot be written"):
        recover(bag, bag / "metadata.yaml" / "new")
    assert not list((tmp_path / "new").iterdir())
    assert (tmp_path / "other.partial").exists()


def test_the_command_tells_by_its_exit_code_how_much_was_saved(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["recover", str(bag)]) == 0
    assert "10 messages were saved to" in capsys.readouterr().out
    assert (tmp_path / "run_recovered" / "metadata.yaml").exists()
    assert main(["recover", str(bag)]) == 2
    assert "run_recovered exists already" in capsys.readouterr().err

    whole, found = file_of(bag).read_bytes(), chunks(file_of(bag))
    file_of(bag).write_bytes(whole[: found[5][0] + 20])
    assert main(["recover", str(bag), "--output", str(tmp_path / "part")]) == 3
    assert "3 saved  /topic_0" in capsys.readouterr().out

    for content in (whole[: found[0][0]], b"", b"no bag"):
        file_of(bag).write_bytes(content)
        assert main(["recover", str(bag), "--output", str(tmp_path / "none")]) == 1
        assert "nothing was saved" in capsys.readouterr().out
    assert main(["recover", str(tmp_path / "nowhere")]) == 2
    assert not (tmp_path / "none").exists()
    assert not list(tmp_path.glob("*.partial"))
