"""Tests of ff_planner_ros.bag.writer, against rosbags, mcap and a killed process."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from answers import EXCHANGES, exchange
from ff_planner_msgs.msg import ChaserState, Exchange, PlanRequest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from std_msgs.msg import String

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.mcap.rosbag2_metadata import QualityOfService
from ff_planner_ros.bag.recover import recover
from ff_planner_ros.bag.writer import BagWriter, unique_directory
from ff_planner_ros.errors import BagError

START = 1_760_000_000_000_000_000
RELIABLE = QualityOfService()
LATCHED = QualityOfService(durability="transient_local", depth=1)
SENSOR = QualityOfService(reliability="best_effort", depth=5)
STATE = "/chaser_state"


def chaser_state(index: int) -> ChaserState:
    state = ChaserState(joint_names=["j1", "j2"], joint_positions=[0.1 * index, -1.0])
    state.header.frame_id = "inertial"
    state.pose.position.y = 2.0 + index
    return state


def asked() -> Exchange:
    request = PlanRequest(duration=10.0, start_state=[chaser_state(1)])
    request.search.points = 50
    return exchange(request=request)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A complete bag: three states 0.1 s apart, then one exchange."""
    directory = tmp_path / "run"
    with BagWriter(directory, flush_interval=0.15) as writer:
        writer.attach("robot.urdf", "application/xml", b"<robot/>")
        writer.add_topic(STATE, "ff_planner_msgs/msg/ChaserState", [RELIABLE, SENSOR])
        writer.add_topic(EXCHANGES, "ff_planner_msgs/msg/Exchange", [LATCHED])
        writer.add_topic("/silent", "std_msgs/msg/String", [])
        for index in range(3):
            stamp = START + index * 100_000_000
            writer.write(STATE, encode(chaser_state(index)), stamp, stamp - 5)
        writer.write(EXCHANGES, encode(asked()), START + 1_000_000_000, START + 999_999_000)
    return directory


def file_of(directory: Path) -> Path:
    return directory / f"{directory.name}_0.mcap"


def metadata_of(directory: Path) -> dict:
    text = (directory / "metadata.yaml").read_text()
    return yaml.safe_load(text)["rosbag2_bagfile_information"]


def streamed(file: Path) -> Iterator[object]:
    """Yield every record up to where the file breaks off."""
    with file.open("rb") as stream, suppress(EndOfFile):
        yield from StreamReader(stream, validate_crcs=True).records


def test_every_topic_is_read_by_its_own_definition_in_rosbags(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        found = [
            (connection.topic, stamp, reader.deserialize(data, connection.msgtype))
            for connection, stamp, data in reader.messages()
        ]
        topics = {topic: info.msgcount for topic, info in reader.topics.items()}

    assert topics == {STATE: 3, EXCHANGES: 1, "/silent": 0}
    assert [topic for topic, _, _ in found] == [STATE] * 3 + [EXCHANGES]
    for index, (_, stamp, state) in enumerate(found[:3]):
        assert stamp == START + index * 100_000_000
        assert state.header.frame_id == "inertial"
        assert state.pose.position.y == 2.0 + index
        assert state.joint_positions.tolist() == [0.1 * index, -1.0]
    (request,) = found[3][2].request
    assert request.search.points == 50
    assert request.start_state[0].joint_names == ["j1", "j2"]
    assert found[3][2].answer == []


def test_messages_are_decoded_by_mcap_ros2_support(bag: Path) -> None:
    with file_of(bag).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(topics=[STATE]))

    assert [decoded.joint_positions for *_, decoded in found] == [
        [0.1 * index, -1.0] for index in range(3)
    ]
    assert [message.sequence for _, _, message, _ in found] == [0, 1, 2]
    assert [message.publish_time for _, _, message, _ in found] == [
        START + index * 100_000_000 - 5 for index in range(3)
    ]


def test_offered_quality_of_service_is_kept(bag: Path) -> None:
    infinite = QosTime(9223372036, 854775807)

    def offered(reliability: QosReliability, durability: QosDurability, depth: int) -> Qos:
        return Qos(
            QosHistory.KEEP_LAST,
            depth,
            reliability,
            durability,
            infinite,
            infinite,
            QosLiveliness.AUTOMATIC,
            infinite,
            False,
        )

    expected = {
        STATE: [
            offered(QosReliability.RELIABLE, QosDurability.VOLATILE, 10),
            offered(QosReliability.BEST_EFFORT, QosDurability.VOLATILE, 5),
        ],
        EXCHANGES: [offered(QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, 1)],
        "/silent": [],
    }
    for path in (bag, file_of(bag)):  # metadata.yaml, then the channels of the file alone
        with AnyReader([path]) as reader:
            assert {
                one.topic: one.ext.offered_qos_profiles for one in reader.connections
            } == expected


def test_metadata_sums_up_the_bag(bag: Path) -> None:
    metadata = metadata_of(bag)
    extent = {
        "starting_time": {"nanoseconds_since_epoch": START},
        "duration": {"nanoseconds": 1_000_000_000},
        "message_count": 4,
    }

    assert metadata["version"] == 9
    assert metadata["storage_identifier"] == "mcap"
    assert metadata["relative_file_paths"] == ["run_0.mcap"]
    assert metadata["files"] == [{"path": "run_0.mcap", **extent}]
    assert extent.items() <= metadata.items()
    assert [
        (one["topic_metadata"]["name"], one["message_count"])
        for one in metadata["topics_with_message_count"]
    ] == [(STATE, 3), (EXCHANGES, 1), ("/silent", 0)]
    assert sorted(path.name for path in bag.iterdir()) == ["metadata.yaml", "run_0.mcap"]


def test_the_file_alone_has_what_rosbag2_looks_for(bag: Path) -> None:
    with file_of(bag).open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        embedded = [
            record.metadata for record in reader.iter_metadata() if record.name == "rosbag2"
        ]
        attachments = [(one.name, one.media_type, one.data) for one in reader.iter_attachments()]
        profile = reader.get_header().profile

    assert profile == "ros2"
    assert yaml.safe_load(embedded[-1]["serialized_metadata"]) == metadata_of(bag)
    assert summary.statistics.message_count == 4
    assert summary.statistics.message_start_time == START
    assert summary.statistics.message_end_time == START + 1_000_000_000
    assert attachments == [("robot.urdf", "application/xml", b"<robot/>")]
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
    hashes = {
        one["topic_metadata"]["name"]: one["topic_metadata"]["type_description_hash"]
        for one in metadata_of(bag)["topics_with_message_count"]
    }
    for channel in summary.channels.values():
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"] == hashes[channel.topic]


def test_metadata_has_no_yaml_anchors(bag: Path) -> None:
    assert "&id" not in (bag / "metadata.yaml").read_text()


def test_a_bag_without_messages_is_a_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "quiet", 0.25) as writer:
        writer.add_topic("/silent", "std_msgs/msg/String", [RELIABLE])
    with AnyReader([tmp_path / "quiet"]) as reader:
        assert reader.message_count == 0
        assert [one.topic for one in reader.connections] == ["/silent"]


def test_messages_out_of_order_count_from_the_earliest_to_the_latest(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", 0.25) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        for offset in (500, 100, 900, 300):
            writer.write("/text", encode(String()), START + offset, START)
    metadata = metadata_of(tmp_path / "run")
    assert metadata["starting_time"] == {"nanoseconds_since_epoch": START + 100}
    assert metadata["duration"] == {"nanoseconds": 800}


@pytest.mark.law("BAG-09")
def test_an_existing_directory_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(BagError, match="run exists already"):
        BagWriter(tmp_path / "run", 0.25)
    assert list((tmp_path / "run").iterdir()) == []


def test_a_directory_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"file/run cannot be written: .*Not a directory"):
        BagWriter(tmp_path / "file" / "run", 0.25)


def test_a_directory_of_bags_is_made_where_there_is_none(tmp_path: Path) -> None:
    BagWriter(tmp_path / "a" / "b" / "run", 0.25).close()
    assert metadata_of(tmp_path / "a" / "b" / "run")["message_count"] == 0


@pytest.mark.parametrize(
    ("owner_only", "directory_mode", "file_mode"), [(True, 0o700, 0o600), (False, 0o775, 0o664)]
)
def test_a_bag_is_the_owners_alone_where_that_is_asked_for(
    tmp_path: Path, owner_only: bool, directory_mode: int, file_mode: int
) -> None:
    """From its first moment on: whoever opens a file in that moment keeps it."""
    before = os.umask(0o002)
    created: list[int] = []
    try:
        with BagWriter(tmp_path / "bags" / "bag", 0.25, owner_only=owner_only) as bag:
            created += [path.stat().st_mode & 0o777 for path in (tmp_path / "bags/bag").iterdir()]
            bag.split()
    finally:
        os.umask(before)
    written = tmp_path / "bags" / "bag"
    assert written.stat().st_mode & 0o777 == directory_mode
    files = [path.stat().st_mode & 0o777 for path in written.iterdir()]
    assert len(files) == 3
    assert {*created, *files} == {file_mode}


def test_directories_named_in_the_same_second_differ(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.gmtime", lambda: time.struct_time((2026, 1, 2, 3, 4, 5, 4, 2, 0)))
    directories = {unique_directory(tmp_path, "ff_planner") for _ in range(200)}
    assert len(directories) == 200
    assert all(one.parent == tmp_path for one in directories)
    assert all(one.name.startswith("ff_planner_20260102_030405_") for one in directories)


@pytest.mark.parametrize("times", [(-1, 0), (0, -1), (2**63, 0), (0, 2**63)])
def test_a_time_that_rosbag2_cannot_hold_is_refused(tmp_path: Path, times: tuple[int, int]) -> None:
    with BagWriter(tmp_path / "run", 0.25) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        with pytest.raises(BagError, match="time of a message on /text is"):
            writer.write("/text", encode(String()), *times)
    assert metadata_of(tmp_path / "run")["message_count"] == 0


def test_a_topic_that_was_not_added_is_refused_by_name(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", 0.25) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        with pytest.raises(BagError, match=r"topic /other was not added .* \['/text'\]"):
            writer.write("/other", b"", START, START)


def test_a_topic_is_added_once(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", 0.25) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        with pytest.raises(BagError, match="topic /text is in bag"):
            writer.add_topic("/text", "std_msgs/msg/String", [])


def test_a_closed_bag_takes_nothing_more(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "other", 0.25)
    writer.add_topic("/text", "std_msgs/msg/String", [])
    writer.close()
    writer.close()  # again does no harm
    for use in (
        lambda: writer.write("/text", encode(String()), START, START),
        lambda: writer.add_topic("/more", "std_msgs/msg/String", []),
        lambda: writer.attach("a", "text/plain", b""),
        writer.flush,
    ):
        with pytest.raises(BagError, match="other is closed"):
            use()


def test_threads_write_without_losing_a_message(tmp_path: Path) -> None:
    switch_interval = sys.getswitchinterval()
    with BagWriter(tmp_path / "run", 0.001) as writer:

        def write(number: int) -> None:
            writer.add_topic(f"/{number}", "std_msgs/msg/String", [])
            for index in range(300):
                message = encode(String(data=f"{number}:{index}"))
                writer.write(f"/{number}", message, START + index * 100_000, START)

        threads = [threading.Thread(target=write, args=(number,)) for number in range(4)]
        sys.setswitchinterval(1e-6)
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        finally:
            sys.setswitchinterval(switch_interval)

    with AnyReader([tmp_path / "run"]) as reader:
        found = sorted(
            (connection.topic, stamp, reader.deserialize(data, connection.msgtype).data)
            for connection, stamp, data in reader.messages()
        )
    assert found == [
        (f"/{number}", START + index * 100_000, f"{number}:{index}")
        for number in range(4)
        for index in range(300)
    ]


def texts(path: Path) -> list[str]:
    """The texts in a bag, or in one of its files alone."""
    with AnyReader([path]) as reader:
        return [reader.deserialize(data, one.msgtype).data for one, _, data in reader.messages()]


def split_bag(
    directory: Path, offsets: Iterable[int], size: int = 1, **limits: float
) -> list[Path]:
    """Write a text at each log time, and return the files."""
    noise = random.Random(1)
    with BagWriter(directory, 1000.0, **limits) as writer:
        writer.attach("robot.urdf", "application/xml", b"<robot/>")
        writer.add_record("origin", {"host": "moon"})
        writer.add_topic("/text", "std_msgs/msg/String", [LATCHED])
        writer.add_topic("/silent", "std_msgs/msg/String", [])
        for offset in offsets:
            text = f"{offset}:{noise.randbytes(size).hex()}"  # hardly to be compressed
            writer.write("/text", encode(String(data=text)), START + offset, START)
    return [directory / name for name in metadata_of(directory)["relative_file_paths"]]


def test_a_file_ends_before_it_becomes_too_long(tmp_path: Path) -> None:
    files = split_bag(tmp_path / "run", range(0, 1_000_000_001, 100_000_000), max_duration=0.4)
    assert [file.name for file in files] == ["run_0.mcap", "run_1.mcap", "run_2.mcap"]
    found = [[int(text.partition(":")[0]) // 100_000_000 for text in texts(file)] for file in files]
    assert found == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9], [10]]
    metadata = metadata_of(tmp_path / "run")
    assert metadata["message_count"] == 11
    assert metadata["duration"] == {"nanoseconds": 1_000_000_000}
    assert metadata["files"] == [
        {
            "path": f"run_{number}.mcap",
            "starting_time": {"nanoseconds_since_epoch": START + number * 500_000_000},
            "duration": {"nanoseconds": duration},
            "message_count": count,
        }
        for number, (duration, count) in enumerate([(400_000_000, 5), (400_000_000, 5), (0, 1)])
    ]
    with AnyReader([tmp_path / "run"]) as reader:
        assert [stamp - START for _, stamp, _ in reader.messages()] == list(
            range(0, 1_000_000_001, 100_000_000)
        )


def test_a_file_ends_before_it_becomes_too_large_its_index_not_counted(tmp_path: Path) -> None:
    limit = 20_000
    files = split_bag(tmp_path / "run", range(200), size=500, max_size=limit)
    assert len(files) > 4
    for number, file in enumerate(files):
        with file.open("rb") as stream:
            index = make_reader(stream).get_summary().chunk_indexes[-1]
        end = index.chunk_start_offset + index.chunk_length
        assert end <= limit
        # And not much before: the next message would have taken half a kilobyte more.
        assert end > limit - 2_500 or number == len(files) - 1
    written = [text for file in files for text in texts(file)]
    assert [int(text.partition(":")[0]) for text in written] == list(range(200))
    assert texts(tmp_path / "run") == written


def test_what_compresses_well_fills_a_file_all_the_same(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", 1000.0, max_size=20_000) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        for offset in range(300):
            writer.write("/text", encode(String(data="again " * 100)), START + offset, START)
    assert metadata_of(tmp_path / "run")["relative_file_paths"] == ["run_0.mcap"]


def test_a_message_that_is_larger_than_a_file_gets_one_of_its_own(tmp_path: Path) -> None:
    files = split_bag(tmp_path / "run", range(3), size=5_000, max_size=100)
    assert [len(texts(file)) for file in files] == [1, 1, 1]


def test_each_file_of_a_split_bag_explains_itself(tmp_path: Path) -> None:
    files = split_bag(tmp_path / "run", [0, 10**9], max_duration=0.5)
    assert len(files) == 2
    for file in files:
        with file.open("rb") as stream:
            reader = make_reader(stream)
            attachments = [(one.name, one.data) for one in reader.iter_attachments()]
            records = {one.name: one.metadata for one in reader.iter_metadata()}
            channels = {one.topic for one in reader.get_summary().channels.values()}
        assert attachments == [("robot.urdf", b"<robot/>")]
        assert records["origin"] == {"host": "moon"}
        assert channels == {"/text", "/silent"}


def test_metadata_lists_each_file_as_soon_as_it_is_begun(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", 0.25) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        for number in range(3):
            writer.custom_data["dropped"] = str(number)
            assert writer.split() == (
                tmp_path / "run" / f"run_{number}.mcap",
                tmp_path / "run" / f"run_{number + 1}.mcap",
            )
            metadata = metadata_of(tmp_path / "run")
            assert metadata["relative_file_paths"] == [f"run_{n}.mcap" for n in range(number + 2)]
            assert metadata["custom_data"] == {"dropped": str(number)}


def test_a_disk_that_fails_while_a_file_is_begun_ends_the_bag(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", 0.25)
    writer.add_topic("/text", "std_msgs/msg/String", [])
    writer.write("/text", encode(String(data="kept")), START, START)
    (tmp_path / "run" / "run_1.mcap").touch()
    for use in (writer.split, writer.flush):
        with pytest.raises(BagError, match=r"run cannot be written: .*File exists"):
            use()
    writer.close()
    assert texts(tmp_path / "run" / "run_0.mcap") == ["kept"]


def test_a_flush_reaches_the_disk_and_costs_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr("os.fdatasync", synced.append)
    with BagWriter(tmp_path / "run", 1000.0) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        for _ in range(2):
            writer.write("/text", encode(String()), START, START)
            writer.flush()
            writer.flush()
    assert len(synced) == 2


UNFINISHED = """
import sys
from pathlib import Path
from std_msgs.msg import String
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.writer import BagWriter

writer = BagWriter(Path(sys.argv[1]), flush_interval=0.25)
writer.add_topic("/text", "std_msgs/msg/String", [])
for offset in eval(sys.argv[2]):
    writer.write("/text", encode(String(data=str(offset))), offset, offset)
eval(sys.argv[3])
print("written", flush=True)
sys.stdin.read()
"""


def left_by_a_killed_writer(
    directory: Path, log_times: str, last_action: str = "None"
) -> list[int]:
    """Return the log times that are in the file after SIGKILL."""
    command = [sys.executable, "-c", UNFINISHED, str(directory), log_times, last_action]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"written\n"
        process.kill()
    records = streamed(file_of(directory))
    return [record.log_time for record in records if isinstance(record, Message)]


@pytest.mark.law("BAG-05")
def test_a_killed_writer_loses_at_most_the_last_flush_interval(tmp_path: Path) -> None:
    written = range(0, 10_120_000_000, 10_000_000)
    found = left_by_a_killed_writer(tmp_path / "run", repr(written))
    assert found == list(written)[: len(found)]
    assert written[-1] - found[-1] < 250_000_000


def test_messages_of_one_flush_interval_are_compressed_together(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", 0.25) as writer:
        writer.add_topic("/text", "std_msgs/msg/String", [])
        for offset in range(0, 1_040_000_000, 10_000_000):
            writer.write("/text", encode(String()), offset, offset)
    with file_of(tmp_path / "run").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert len(chunks) == 4


def test_a_clock_that_is_set_back_does_not_put_off_the_flush(tmp_path: Path) -> None:
    times = [10_000_000_000, 10_010_000_000, *range(0, 1_000_000_000, 10_000_000)]
    found = left_by_a_killed_writer(tmp_path / "run", repr(times))
    assert found == times[: len(found)]
    assert times[-1] - found[-1] < 250_000_000


def test_a_killed_writer_loses_nothing_that_was_flushed(tmp_path: Path) -> None:
    found = left_by_a_killed_writer(tmp_path / "run", "[1, 2, 3]", "writer.flush()")
    assert found == [1, 2, 3]


def test_a_killed_writer_leaves_metadata(tmp_path: Path) -> None:
    left_by_a_killed_writer(tmp_path / "run", "[1]", "writer.flush()")
    assert metadata_of(tmp_path / "run")["relative_file_paths"] == ["run_0.mcap"]
    assert metadata_of(tmp_path / "run")["version"] == 9


FILLING = """
import random, resource, sys
from pathlib import Path
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError

writer = BagWriter(Path(sys.argv[1]), flush_interval=0.25)
writer.add_topic("/noise", "std_msgs/msg/UInt8MultiArray", [])
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))  # a disk that is full
noise = random.Random(1)
for index in range(1000):
    try:
        writer.write("/noise", noise.randbytes(1000), index * 100_000_000, 0)
    except BagError as error:
        print(error)
        break
try:
    writer.flush()
except BagError as error:
    print(error)
writer.close()
"""


@pytest.mark.law("BAG-08")
def test_a_full_disk_ends_the_bag_and_says_so(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FILLING, str(tmp_path / "run")]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    first, second = output.splitlines()
    assert first == second
    assert "run cannot be written: " in first
    assert "File too large" in first
    kept = Counter(type(one) for one in streamed(file_of(tmp_path / "run")))[Message]
    assert kept > 80
    assert recover(tmp_path / "run", tmp_path / "saved").saved == {"/noise": kept}
