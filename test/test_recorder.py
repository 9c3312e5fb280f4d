"""The recorder: what arrives is in the bag, what is not is counted, a broken bag ends nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import rclpy
import yaml
from ff_planner_msgs.msg import ChaserState, Exchange
from mcap.reader import make_reader
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_processes import DEADLINE, private_domain, read_bag
from std_msgs.msg import String

from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.recorder import recorder
from ff_planner_ros.ros.recorder.recorder import RecordedTopic, Recorder

STATE = RecordedTopic("/chaser_state", ChaserState, QoSProfile(depth=1))
EXCHANGES = RecordedTopic("/exchanges", Exchange, QoSProfile(depth=1))
SCENE = RecordedTopic(
    "/scene", String, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
)
QUEUE = recorder._QUEUE


@pytest.fixture(autouse=True)
def node() -> Iterator[Node]:
    with private_domain():
        rclpy.init(args=[])
        yield rclpy.create_node("publisher")
        rclpy.shutdown()


class Log:
    """What was logged, by level."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def error(self, message: str) -> None:
        self.lines.append(f"ERROR {message}")

    def warning(self, message: str) -> None:
        self.lines.append(f"WARN {message}")

    def info(self, message: str) -> None:
        self.lines.append(f"INFO {message}")


def _recorder(
    directory: Path,
    *topics: RecordedTopic,
    bag: Callable[[], BagWriter] | None = None,
    log: Log | None = None,
    flush_interval: float = 1000.0,
) -> Recorder:
    """A recorder that acts when it is told to: its flush interval never ends."""
    open_bag = bag or (lambda: BagWriter(directory, flush_interval))
    logger = log or Log()
    return Recorder(open_bag, directory, topics, flush_interval, "recorder", "/servicer", logger)


def _number(number: int) -> ChaserState:
    return ChaserState(joint_positions=[float(number)])


def _numbers(directory: Path) -> list[int]:
    """The numbers recorded."""
    return [int(state.joint_positions[0]) for state in read_bag(directory)["/chaser_state"]]


def _custom_data(directory: Path) -> dict[str, str]:
    document = yaml.safe_load((directory / "metadata.yaml").read_text())
    return document["rosbag2_bagfile_information"]["custom_data"]


def test_what_has_arrived_when_it_is_closed_is_in_the_bag(tmp_path: Path, node: Node) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(tmp_path / "bag", STATE)):
        for number in range(500):
            publisher.publish(_number(number))
    assert _numbers(tmp_path / "bag") == list(range(500))
    assert _custom_data(tmp_path / "bag") == {"dropped": "0"}


def test_what_nobody_wants_is_left_out_and_is_not_called_dropped(
    tmp_path: Path, node: Node
) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(tmp_path / "bag", STATE)) as recorder:
        publisher.publish(_number(1))
        recorder.split()
        since_ns = time.time_ns()
        recorder.leave_out("/chaser_state", lambda received_ns: since_ns <= received_ns < until_ns)
        publisher.publish(_number(2))
        until_ns = time.time_ns()
        publisher.publish(_number(3))
    assert _numbers(tmp_path / "bag") == [1, 3]
    assert _custom_data(tmp_path / "bag") == {"dropped": "0"}


def test_what_arrives_reaches_the_disk_without_being_asked_for(tmp_path: Path, node: Node) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(tmp_path / "bag", STATE, flush_interval=0.01)) as recorder:
        file = tmp_path / "bag" / "bag_0.mcap"
        empty = file.stat().st_size
        publisher.publish(_number(1))
        give_up = time.monotonic() + DEADLINE
        while file.stat().st_size == empty:
            assert time.monotonic() < give_up
        assert recorder.health.messages == 1


def test_a_message_has_the_time_it_was_published_and_received(tmp_path: Path, node: Node) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(tmp_path / "bag", STATE)):
        before = time.time_ns()
        publisher.publish(ChaserState())
        after = time.time_ns()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        ((_, _, message),) = make_reader(stream).iter_messages()
    assert before <= message.publish_time <= after
    assert message.publish_time <= message.log_time


def test_messages_of_all_topics_lie_in_the_file_as_they_came(tmp_path: Path, node: Node) -> None:
    states = node.create_publisher(ChaserState, "chaser_state", 100)
    scenes = node.create_publisher(String, "scene", SCENE.qos)
    with closing(_recorder(tmp_path / "bag", STATE, SCENE)):
        for number in range(3):
            states.publish(_number(number))
            scenes.publish(String())
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        in_file = make_reader(stream).iter_messages(log_time_order=False)
        topics = [channel.topic for _, channel, _ in in_file]
    assert topics == ["/chaser_state", "/scene"] * 3


def test_what_was_latched_before_is_in_the_bag_and_asked_for_first(
    tmp_path: Path, node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    subscribe = Node.create_subscription

    def noted(self: Node, message_type: type, topic: str, *rest: Any, **more: Any) -> Any:
        asked.append(topic)
        return subscribe(self, message_type, topic, *rest, **more)

    monkeypatch.setattr(Node, "create_subscription", noted)
    node.create_publisher(String, "scene", SCENE.qos).publish(String(data="latched"))
    with closing(_recorder(tmp_path / "bag", STATE, SCENE, EXCHANGES)) as recorder:
        give_up = time.monotonic() + DEADLINE
        while recorder.health.messages == 0:
            assert time.monotonic() < give_up
            recorder._take_all()
    assert asked == ["/scene", "/chaser_state", "/exchanges"]
    assert [scene.data for scene in read_bag(tmp_path / "bag")["/scene"]] == ["latched"]


def test_topics_have_the_type_names_of_ros(tmp_path: Path) -> None:
    bag = Mock(spec=BagWriter, custom_data={})
    _recorder(tmp_path, STATE, EXCHANGES, bag=lambda: bag).close()
    assert [call.args[:2] for call in bag.add_topic.call_args_list] == [
        ("/chaser_state", "ff_planner_msgs/msg/ChaserState"),
        ("/exchanges", "ff_planner_msgs/msg/Exchange"),
    ]
    bag.close.assert_called_once_with()


def test_a_full_queue_is_counted_to_the_message_and_told(tmp_path: Path, node: Node) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    log = Log()
    with closing(_recorder(tmp_path / "bag", STATE, EXCHANGES, log=log)) as recorder:
        publisher.publish(_number(0))
        recorder._take_all()
        for number in range(1, QUEUE + 235):
            publisher.publish(_number(number))
        recorder._take_all()
        assert recorder.health.dropped == {"/chaser_state": 234}
        assert recorder.health.messages == 1 + QUEUE
        publisher.publish(_number(QUEUE + 235))
    assert _numbers(tmp_path / "bag") == [0, *range(235, QUEUE + 236)]
    assert _custom_data(tmp_path / "bag") == {"dropped": "234", "dropped /chaser_state": "234"}
    (told,) = [line for line in log.lines if line.startswith("ERROR")]
    assert "not in the bag: 234 of /chaser_state; 234 since the start" in told


def test_a_flood_of_4_khz_is_recorded_to_the_last_message(tmp_path: Path, node: Node) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    flood = 8000  # more than a queue holds: it must be emptied meanwhile
    with closing(_recorder(tmp_path / "bag", STATE, flush_interval=0.25)) as recorder:
        begun, number = time.monotonic(), 0
        while number < flood:
            while number < min(flood, (time.monotonic() - begun) * 4000.0):
                publisher.publish(_number(number))
                number += 1
            time.sleep(0.001)  # what a publisher of this rate does
    assert recorder.health.dropped == {}
    assert recorder.health.messages == flood > QUEUE
    assert _numbers(tmp_path / "bag") == list(range(flood))


def test_every_publisher_is_counted_by_its_own_numbers(tmp_path: Path, node: Node) -> None:
    first, second, early = (
        node.create_publisher(ChaserState, "chaser_state", 1000) for _ in range(3)
    )
    for number in range(200):
        early.publish(_number(number))  # before anybody listens
    with closing(_recorder(tmp_path / "bag", STATE)) as recorder:
        for publisher, count in ((first, 100), (second, 3)):
            for number in range(count):
                publisher.publish(_number(number))
        recorder._take_all()
        third = node.create_publisher(ChaserState, "chaser_state", 1000)
        for publisher in (second, first, third, early):
            publisher.publish(_number(0))
        recorder._take_all()
        assert recorder.health.dropped == {}
        for number in range(QUEUE + 50):
            second.publish(_number(number))
        recorder._take_all()
        assert recorder.health.dropped == {"/chaser_state": 50}


def test_a_queue_that_is_full_before_anything_was_heard_has_lost_one_at_least(
    tmp_path: Path, node: Node
) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(tmp_path / "bag", STATE)) as recorder:
        for number in range(QUEUE + 5):
            publisher.publish(_number(number))
        recorder._take_all()
        assert recorder.health.dropped == {"/chaser_state": 1}


def test_a_split_completes_a_file_with_all_that_came_before(tmp_path: Path, node: Node) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(tmp_path / "bag", STATE)) as recorder:
        publisher.publish(_number(0))
        message = recorder.split()
        publisher.publish(_number(1))
    assert message == f"{tmp_path}/bag/bag_0.mcap is complete, recording goes on in bag_1.mcap"
    for number in (0, 1):
        with (tmp_path / "bag" / f"bag_{number}.mcap").open("rb") as stream:
            assert make_reader(stream).get_summary().statistics.message_count == 1
    assert _numbers(tmp_path / "bag") == [0, 1]


def test_a_bag_that_fails_is_left_alone_from_then_on_and_told_once(
    tmp_path: Path, node: Node
) -> None:
    publisher = node.create_publisher(ChaserState, "chaser_state", 1000)
    bag, log = Mock(spec=BagWriter, custom_data={}, message_count=0), Log()
    bag.write.side_effect = BagError("the disk is full")
    with closing(_recorder(tmp_path, STATE, bag=lambda: bag, log=log)) as recorder:
        for _ in range(3):
            publisher.publish(ChaserState())
        for _ in range(2):
            with pytest.raises(BagError, match="recording has stopped: the disk is full"):
                recorder.split()
        assert recorder.health.failure == "the disk is full"
        assert recorder.health.dropped == {"/chaser_state": 3}
    bag.write.assert_called_once()
    (told,) = log.lines
    assert told.startswith("ERROR recording has stopped, planning goes on: the disk is full")


def test_a_bag_that_cannot_be_opened_is_a_failure_and_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    log = Log()
    with closing(_recorder(tmp_path / "file" / "bag", STATE, log=log)) as recorder:
        assert "Not a directory" in recorder.health.failure
        assert recorder.health.bag == str(tmp_path / "file" / "bag")
        with pytest.raises(BagError, match="recording has stopped"):
            recorder.split()
    assert len(log.lines) == 1


def test_a_bag_that_does_not_take_a_topic_is_a_failure(tmp_path: Path) -> None:
    with closing(_recorder(tmp_path / "bag", STATE, STATE)) as recorder:
        assert "/chaser_state" in recorder.health.failure
    assert list(read_bag(tmp_path / "bag")) == ["/chaser_state"]


def test_what_nobody_foresaw_ends_recording_with_words_and_nothing_else(tmp_path: Path) -> None:
    bag, log = Mock(spec=BagWriter, custom_data={}, message_count=0), Log()
    bag.flush.side_effect = ZeroDivisionError("surprise")
    recorder = _recorder(tmp_path, STATE, bag=lambda: bag, log=log, flush_interval=0.01)
    give_up = time.monotonic() + DEADLINE
    while not recorder.health.failure:
        assert time.monotonic() < give_up
    recorder.close()
    assert recorder.health.failure == "ZeroDivisionError: surprise"
    assert "Traceback" in log.lines[0]
