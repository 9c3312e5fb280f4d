"""What comes in is taken in a thread of its own, whatever the executor does."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import closing
from unittest.mock import Mock

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from ros_processes import DEADLINE, private_domain
from std_msgs.msg import String

from ff_planner_ros.ros.inputs.listener import Listener

MESSAGES = 200
QOS = QoSProfile(depth=MESSAGES)


@pytest.fixture
def node() -> Iterator[Node]:
    with private_domain():
        rclpy.init(args=[])
        yield rclpy.create_node("hearer")
        rclpy.shutdown()


class Kept:
    """What was handed over, and an event when as much as is expected was."""

    def __init__(self, expected: int) -> None:
        self.messages = list[str]()
        self.all, self._expected = threading.Event(), expected

    def __call__(self, cdr: bytes, _: int | None) -> None:
        self.messages.append(deserialize_message(cdr, String).data)
        if len(self.messages) == self._expected:
            self.all.set()


def test_every_message_is_handed_over_in_order_while_no_executor_spins(node: Node) -> None:
    small, large = Kept(MESSAGES), Kept(1)
    publishers = [node.create_publisher(String, topic, QOS) for topic in ("small", "large")]
    with closing(Listener(node)) as listener:
        listener.add(String, "small", small, QOS)
        listener.add(String, "large", large, QOS)
        listener.start()
        for number in range(MESSAGES):
            publishers[0].publish(String(data=str(number)))
        publishers[1].publish(String(data="x" * 1_000_000))
        assert small.all.wait(DEADLINE)
        assert large.all.wait(DEADLINE)
    assert small.messages == [str(number) for number in range(MESSAGES)]
    assert large.messages == ["x" * 1_000_000]


def test_the_executor_leaves_its_topics_alone_and_one_bad_message_ends_nothing(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, kept, threads = Mock(), Kept(1), list[str]()
    monkeypatch.setattr(node, "get_logger", lambda: log)

    def keep(cdr: bytes, number: int | None) -> None:
        if deserialize_message(cdr, String).data == "bad":
            raise ZeroDivisionError
        threads.append(threading.current_thread().name)
        kept(cdr, number)

    publisher = node.create_publisher(String, "plain", QOS)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with closing(Listener(node)) as listener:
        listener.add(String, "plain", keep, QOS)
        publisher.publish(String(data="bad"))
        publisher.publish(String(data="good"))
        executor.spin_once(timeout_sec=0.0)
        assert not kept.messages
        listener.start()
        assert kept.all.wait(DEADLINE)
    assert (kept.messages, threads) == (["good"], ["listener"])
    assert "ZeroDivisionError" in log.error.call_args.args[0]
    assert not list(node.subscriptions)


def test_a_publisher_that_does_not_fit_is_told_by_the_executor(
    node: Node, capfd: pytest.CaptureFixture[str]
) -> None:
    weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    executor, told = SingleThreadedExecutor(), ""
    executor.add_node(node)
    with closing(Listener(node)) as listener:
        listener.add(String, "plain", Kept(1), QOS)
        listener.start()
        node.create_publisher(String, "plain", weak)
        give_up = time.monotonic() + DEADLINE
        while "incompatible QoS" not in told:
            assert time.monotonic() < give_up
            executor.spin_once(timeout_sec=0.1)
            told += capfd.readouterr().err
    assert "RELIABILITY" in told
