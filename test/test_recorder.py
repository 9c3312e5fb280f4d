"""The recorder: what has arrived when it is closed is in the bag, and a broken bag ends nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from unittest.mock import Mock

import pytest
import rclpy
from ff_planner_msgs.msg import ChaserState
from ff_planner_msgs.srv import PlanTrajectory
from mcap.reader import make_reader
from rclpy.qos import QoSProfile
from ros_processes import private_domain, read_bag

from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.recorder import RecordedTopic, Recorder

STATE = RecordedTopic("/chaser_state", ChaserState, QoSProfile(depth=1))
EVENT = RecordedTopic("/plan/_service_event", PlanTrajectory.Event, QoSProfile(depth=1))


@pytest.fixture(autouse=True)
def ros() -> Iterator[None]:
    with private_domain():
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


def _recorder(bag: BagWriter, *topics: RecordedTopic) -> Recorder:
    return Recorder(bag, topics, 10.0, "recorder", "/servicer")


def test_what_has_arrived_when_it_is_closed_is_in_the_bag(tmp_path: Path) -> None:
    publisher = rclpy.create_node("publisher").create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(BagWriter(tmp_path / "bag", 10.0), STATE)):
        for number in range(500):
            publisher.publish(ChaserState(joint_positions=[float(number)]))
    recorded = read_bag(tmp_path / "bag")["/chaser_state"]
    assert [message.joint_positions.tolist() for message in recorded] == [[n] for n in range(500)]


def test_a_message_has_the_time_it_was_published_and_received(tmp_path: Path) -> None:
    publisher = rclpy.create_node("publisher").create_publisher(ChaserState, "chaser_state", 1000)
    with closing(_recorder(BagWriter(tmp_path / "bag", 10.0), STATE)):
        before = time.time_ns()
        publisher.publish(ChaserState())
        after = time.time_ns()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        ((_, _, message),) = make_reader(stream).iter_messages()
    assert before <= message.publish_time <= after
    assert message.publish_time <= message.log_time


def test_topics_have_the_type_names_of_ros() -> None:
    bag = Mock(spec=BagWriter)
    _recorder(bag, STATE, EVENT).close()
    assert [call.args[:2] for call in bag.add_topic.call_args_list] == [
        ("/chaser_state", "ff_planner_msgs/msg/ChaserState"),
        ("/plan/_service_event", "ff_planner_msgs/srv/PlanTrajectory_Event"),
    ]
    bag.close.assert_called_once_with()


def test_a_bag_that_fails_is_left_alone_from_then_on() -> None:
    publisher = rclpy.create_node("publisher").create_publisher(ChaserState, "chaser_state", 1000)
    bag = Mock(spec=BagWriter)
    bag.write.side_effect = BagError("the disk is full")
    with closing(_recorder(bag, STATE)):
        for _ in range(3):
            publisher.publish(ChaserState())
    bag.write.assert_called_once()
    bag.close.assert_not_called()


def test_a_bag_that_does_not_take_a_topic_is_told_at_once(tmp_path: Path) -> None:
    with (
        BagWriter(tmp_path / "bag", 10.0) as bag,
        pytest.raises(BagError, match="/chaser_state"),
    ):
        _recorder(bag, STATE, STATE)
