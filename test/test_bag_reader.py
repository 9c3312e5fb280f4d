"""The reader: what was written comes back, and what is damaged never passes for a message."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from evil_bags import END, HEAD, channel, compressed, message, schema
from ff_planner_msgs.msg import ChaserState
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import String

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError

STRING, STATE = "std_msgs/msg/String", "ff_planner_msgs/msg/ChaserState"
WORDS = tuple(encode(String(data=word * 50)) for word in ("one", "two", "three"))
WHOLE = [
    ("/here", STRING, 10, WORDS[0]),
    ("/there", STRING, 11, WORDS[1]),
    ("/here", STRING, 12, WORDS[2]),
    ("/state", STATE, 13, encode(ChaserState(joint_names=["a"]))),
]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    directory = tmp_path / "run"
    with BagWriter(directory, flush_interval=0.0) as writer:
        writer.attach("robot.urdf", "application/xml", b"<robot/>")
        writer.attach("parameters.yaml", "application/yaml", b"a: 1")
        for topic, type_name in (("/here", STRING), ("/there", STRING), ("/state", STATE)):
            writer.add_topic(topic, type_name, [])
        for topic, _, time, cdr in WHOLE:
            writer.write(topic, cdr, time, time - 1)
    return directory


def file_of(bag: Path) -> Path:
    return bag / "run_0.mcap"


def content(path: Path) -> tuple[list[tuple[str, str, int, bytes]], tuple[str, ...]]:
    with open_bag(path) as bag:
        found = [(m.topic, m.type_name, m.log_time_ns, m.cdr) for m in bag.messages()]
        return found, bag.notes


def written_otherwise(path: Path, chunk_size: int = 1 << 20, **options: Any) -> Path:
    """Write the whole bag as other recorders may."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size, **options)
        writer.start(profile="ros2", library="another")
        channels = {}
        for name, text in ((STRING, b"string data\n"), (STATE, b"string[] of_another_version\n")):
            schema = writer.register_schema(name, "ros2msg", text)
            for topic in {topic for topic, type_name, *_ in WHOLE if type_name == name}:
                channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, _, time, cdr in WHOLE:
            writer.add_message(channels[topic], time, cdr, time)
        writer.finish()
    return path


def test_every_message_comes_as_it_was_written(bag: Path) -> None:
    assert content(bag) == (WHOLE, ())
    with open_bag(bag) as opened:
        assert [m.publish_time_ns for m in opened.messages()] == [9, 10, 11, 12]


def test_messages_are_those_that_independent_readers_find(bag: Path) -> None:
    with file_of(bag).open("rb") as stream:
        by_mcap = [
            (channel.topic, schema.name, message.log_time, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
        ]
    with AnyReader([bag]) as reader:
        by_rosbags = [(c.topic, c.msgtype, time, data) for c, time, data in reader.messages()]
    assert content(bag)[0] == by_mcap == by_rosbags


def test_decoded_messages_say_what_an_independent_decoder_says(bag: Path) -> None:
    with open_bag(bag) as opened:
        ours = [text.data for _, text in opened.decoded(STRING)]
        (state,) = [state for _, state in opened.decoded(STATE)]
    with file_of(bag).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        theirs = [found[3].data for found in reader.iter_decoded_messages(["/here", "/there"])]
    assert ours == theirs == ["one" * 50, "two" * 50, "three" * 50]
    assert state.joint_names == ["a"]


def test_messages_are_chosen_by_type_or_topic(bag: Path) -> None:
    with open_bag(bag) as opened:

        def found(*wanted: str) -> list[bytes]:
            return [message.cdr for message in opened.messages(*wanted)]

        assert found(STRING) == list(WORDS)
        assert found("/here") == [WORDS[0], WORDS[2]]
        assert found("/there", STATE) == [WHOLE[1][3], WHOLE[3][3]]
        assert found("/nowhere") == []


def test_a_bag_tells_of_its_topics_and_documents(bag: Path) -> None:
    with open_bag(bag) as opened:
        assert {t.name: (t.type_name, t.message_count) for t in opened.topics.values()} == {
            "/here": (STRING, 2),
            "/there": (STRING, 1),
            "/state": (STATE, 1),
        }
        assert opened.topics["/here"].type_hash.startswith("RIHS01_")
        assert opened.attachments == {"robot.urdf": b"<robot/>", "parameters.yaml": b"a: 1"}
        assert yaml.safe_load(opened.metadata["rosbag2"]["serialized_metadata"])["version"] == 9
        assert (opened.start_ns, opened.end_ns, opened.message_count) == (10, 13, 4)
        assert opened.library.startswith("ff_planner_ros")
        assert opened.size == file_of(bag).stat().st_size


def test_the_file_of_a_bag_is_as_good_as_its_directory(bag: Path) -> None:
    assert content(file_of(bag)) == content(bag)


@pytest.mark.parametrize(
    ("options", "note"),
    [
        ({"compression": CompressionType.LZ4}, None),
        ({"compression": CompressionType.NONE}, None),
        ({"chunk_size": 1}, None),
        (
            {
                "index_types": IndexType.NONE,
                "use_statistics": False,
                "repeat_channels": False,
                "repeat_schemas": False,
                "use_summary_offsets": False,
            },
            "it has no index",
        ),
        ({"index_types": IndexType.NONE}, "its index is not complete"),
        ({"index_types": IndexType.CHUNK, "use_statistics": False}, "its index is not complete"),
        ({"repeat_channels": False, "repeat_schemas": False}, "its index is not complete"),
        ({"repeat_schemas": False}, "its index is not complete"),
        ({"use_chunking": False}, "its index is not complete"),
        ({"enable_crcs": False}, None),
    ],
)
def test_files_of_other_recorders_are_read(
    tmp_path: Path, options: dict[str, Any], note: str | None
) -> None:
    found, notes = content(written_otherwise(tmp_path / "other.mcap", **options))
    assert found == WHOLE
    assert len(notes) == (note is not None)
    assert all(note in one for one in notes)


@pytest.mark.parametrize(
    "options", [{"chunk_size": 1}, {"chunk_size": 1 << 20}, {"use_chunking": False}]
)
def test_messages_of_several_files_are_merged_by_time(
    tmp_path: Path, options: dict[str, Any]
) -> None:
    directory = tmp_path / "split"
    directory.mkdir()
    times = {9: (1, 5, 9), 10: (2, 6, 8), 11: (3, 4, 7)}
    for number, stamps in times.items():
        with (directory / f"run_{number}.mcap").open("wb") as stream:
            writer = Writer(stream, **options)
            writer.start("ros2", "another")
            schema = writer.register_schema(STRING, "ros2msg", b"string data\n")
            channel = writer.register_channel("/text", "cdr", schema)
            for stamp in stamps:
                writer.add_message(channel, stamp, WORDS[0], 100 - stamp)  # when it was published
            writer.finish()
    with open_bag(directory) as bag:
        assert (bag.start_ns, bag.end_ns) == (1, 9)
        assert [file.name for file in bag.files] == ["run_9.mcap", "run_10.mcap", "run_11.mcap"]
        assert [message.log_time_ns for message in bag.messages()] == list(range(1, 10))
        assert bag.topics["/text"].message_count == bag.message_count == 9


def test_a_file_that_is_missing_or_cannot_be_read_leaves_the_others(bag: Path) -> None:
    (bag / "run_1.mcap").write_bytes(b"")
    metadata = bag / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("- run_0.mcap", "- run_0.mcap\n  - run_7.mcap")
    )
    found, notes = content(bag)
    assert found == WHOLE
    assert notes[0] == "metadata.yaml lists run_7.mcap, which is not there"
    assert notes[1].endswith("run_1.mcap: it is empty")


def test_what_is_no_bag_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match=r"empty must hold \.mcap files; found: nothing"):
        content(tmp_path / "empty")
    (tmp_path / "empty" / "notes.txt").touch()
    with pytest.raises(BagError, match=r"found: notes\.txt"):
        content(tmp_path / "empty")
    with pytest.raises(BagError, match=r"none\.mcap cannot be read: No such file"):
        content(tmp_path / "none.mcap")
    for text, reason in (
        (b"", ": it is empty"),
        (b"\x89MC", " is no MCAP"),
        (b"a text", " is no MCAP"),
    ):
        (tmp_path / "other.mcap").write_bytes(text)
        with pytest.raises(BagError, match=rf"other\.mcap{reason}"):
            content(tmp_path / "other.mcap")


def foreign_bag(path: Path, plugin: StoragePlugin) -> Path:
    """Write a bag as rosbags does."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsWriter(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/text", STRING, typestore=store)
        text = store.types[STRING](data="hello")
        writer.write(connection, 7, store.serialize_cdr(text, STRING))
    return path


def test_a_foreign_bag_is_read(tmp_path: Path) -> None:
    with open_bag(foreign_bag(tmp_path / "foreign", StoragePlugin.MCAP)) as bag:
        assert [text.data for _, text in bag.decoded(STRING)] == ["hello"]
        assert bag.notes == ()


def test_a_foreign_bag_in_another_storage_is_refused_with_a_way_out(tmp_path: Path) -> None:
    directory = foreign_bag(tmp_path / "foreign", StoragePlugin.SQLITE3)
    for path in (directory, next(directory.glob("*.db3"))):
        with pytest.raises(BagError, match=r"sqlite3: `ros2 bag convert` it to mcap"):
            content(path)


def test_messages_that_rosbag2_compressed_are_refused_with_a_way_out(bag: Path) -> None:
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    assert "compression_mode: ''" in text
    metadata.write_text(text.replace("compression_mode: ''", "compression_mode: MESSAGE"))
    with pytest.raises(BagError, match="compressed by rosbag2"):
        content(bag)


def test_what_cannot_be_decoded_is_named_and_the_rest_is_read(tmp_path: Path) -> None:
    path = tmp_path / "strange.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros1", "another")
        kinds = [
            ("a/msg/Unknown", "flatbuffer", b"", "cdr"),
            ("a/msg/Garbled", "ros2msg", b"int32[ x\n", "cdr"),
            ("a/msg/Lacking", "ros2msg", b"b/Nowhere x\n", "cdr"),
            ("a/msg/Json", "ros2msg", b"int32 x\n", "json"),
            ("a/msg/Short", "ros2msg", b"int64 x\n", "cdr"),
            ("a/msg/Evil()", "ros2msg", b"int32 x\n", "cdr"),
            ("a/msg/Good", "ros2msg", b"int32 x\n", "cdr"),
        ]
        for number, (name, encoding, text, message_encoding) in enumerate(kinds):
            schema = writer.register_schema(name, encoding, text)
            channel = writer.register_channel(f"/topic_{number}", message_encoding, schema)
            writer.add_message(channel, number, b"\x00\x01\x00\x00\x05\x00\x00\x00", number)
        writer.finish()
    with open_bag(path) as bag:
        decoded = {name: [m.x for _, m in bag.decoded(name)] for name, *_ in kinds}
        assert len(list(bag.messages())) == len(kinds)
        notes = "\n".join(bag.notes)
    assert decoded == {name: [5] if name == "a/msg/Good" else [] for name, *_ in kinds}
    assert "its profile is 'ros1'" in notes
    for name, *_ in kinds[:-1]:
        assert name in notes


def test_a_topic_of_two_types_is_told(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "another")
        for name in ("a/msg/One", "a/msg/Two"):
            schema = writer.register_schema(name, "ros2msg", b"int32 x\n")
            writer.register_channel("/topic", "cdr", schema)
        writer.finish()
    with open_bag(path) as bag:
        assert bag.notes == ("two.mcap: /topic is of a/msg/Two, and of a/msg/One, too",)


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """The whole bag in a file of some 2 kB, with a chunk per message."""
    return written_otherwise(tmp_path / "small.mcap", chunk_size=1)


@pytest.mark.law("BAG-06")
def test_a_bag_cut_short_anywhere_gives_what_comes_before_and_says_so(small: Path) -> None:
    """Every length: never a traceback, never a message that was not written, never silence."""
    whole = small.read_bytes()
    found_before = 0
    for length in range(len(whole)):
        small.write_bytes(whole[:length])
        if length < 8:
            with pytest.raises(BagError, match="empty" if length == 0 else "no MCAP file"):
                content(small)
            continue
        found, notes = content(small)
        assert "it has no end" in notes[0]
        assert found == WHOLE[: len(found)]
        assert len(found) >= found_before  # what was there once stays there
        found_before = len(found)
    assert found_before == len(WHOLE)


def test_a_damaged_document_is_left_out_and_told(bag: Path) -> None:
    whole = file_of(bag).read_bytes()
    file_of(bag).write_bytes(whole.replace(b"<robot/>", b"<rabot/>"))
    with open_bag(bag) as opened:
        assert opened.attachments == {"parameters.yaml": b"a: 1"}
        (note,) = opened.notes
        assert re.search(r"'robot.urdf' at byte \d+ is damaged: its checksum is another", note)
        assert len(list(opened.messages())) == len(WHOLE)


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        (message(1, b"")[:1] + struct.pack("<Q", 21) + bytes(40), "too short"),
        (message(1, b"word")[:-1], "longer than what is left"),
        (message(0, b"word"), "channel 0 of a message is described nowhere"),
    ],
)
def test_a_chunk_with_a_message_that_cannot_be_one_is_left_out(
    tmp_path: Path, record: bytes, reason: str
) -> None:
    file = tmp_path / "run.mcap"
    described = schema(1, STRING, "ros2msg", "string data\n") + channel(1, "/text")
    file.write_bytes(HEAD + described + compressed(message(1, WORDS[0]) + record) + END)
    found, notes = content(file)
    assert found == []
    assert reason in notes[-1]


def flipped(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1 :]


def zeroed(data: bytes, place: int) -> bytes:
    return data[:place] + bytes(40) + data[place + 40 :]


@pytest.mark.law("BAG-07")
@pytest.mark.parametrize("damage", [flipped, zeroed])
def test_no_damage_passes_for_a_message(small: Path, damage: Callable[[bytes, int], bytes]) -> None:
    whole = small.read_bytes()
    cdrs = {cdr for *_, cdr in WHOLE}
    noted = 0
    for place in range(8, len(whole) - 48, 2):
        small.write_bytes(damage(whole, place))
        found, notes = content(small)
        assert {cdr for *_, cdr in found} <= cdrs
        if len(found) < len(WHOLE):
            assert notes, place
            noted += 1
    assert noted > 100


def test_a_damaged_chunk_is_left_out_and_told_and_the_others_are_read(small: Path) -> None:
    whole = small.read_bytes()
    with small.open("rb") as stream:
        index = make_reader(stream).get_summary().chunk_indexes[1]
    place = index.chunk_start_offset + index.chunk_length - 5
    small.write_bytes(flipped(whole, place))
    found, notes = content(small)
    assert found == [WHOLE[0], *WHOLE[2:]]
    assert f"the chunk at byte {index.chunk_start_offset} is damaged" in notes[0]
