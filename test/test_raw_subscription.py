"""Messages wait in the middleware until they are taken, whatever the executor does."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from ros_processes import DEADLINE, private_domain
from std_msgs.msg import String

from ff_planner_ros.ros.inputs.raw_subscription import RawSubscription

MESSAGES = 200
QOS = QoSProfile(depth=MESSAGES)


@pytest.fixture
def node() -> Iterator[Node]:
    with private_domain():
        rclpy.init(args=[])
        yield rclpy.create_node("hearer")
        rclpy.shutdown()


def taken(subscription: RawSubscription, is_enough: Callable[[list[str]], bool]) -> list[str]:
    """Take until there is enough."""
    found, give_up = list[str](), time.monotonic() + DEADLINE
    while not is_enough(found):
        assert time.monotonic() < give_up
        found += [deserialize_message(cdr, String).data for cdr, _ in subscription.take()]
    return found


@pytest.mark.parametrize("messages", [[str(k) for k in range(MESSAGES)], ["x" * 1_000_000]])
def test_every_message_is_taken_once_in_order_and_the_executor_takes_none(
    node: Node, messages: list[str]
) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    subscription = RawSubscription(node, String, "words", QOS)
    publisher = node.create_publisher(String, "words", QOS)
    for message in messages:
        publisher.publish(String(data=message))
        executor.spin_once(timeout_sec=0.0)
    assert taken(subscription, lambda found: len(found) >= len(messages)) == messages
    assert subscription.take() == []
    subscription.close()
    assert not list(node.subscriptions)


def test_of_more_than_fit_the_newest_wait_and_when_each_came_is_known(node: Node) -> None:
    subscription = RawSubscription(node, String, "words", QoSProfile(depth=5))
    publisher = node.create_publisher(String, "words", QOS)
    before_ns = time.time_ns()
    for number in range(MESSAGES):
        publisher.publish(String(data=str(number)))
    found = taken(subscription, lambda found: str(MESSAGES - 1) in found)
    assert found == sorted(found, key=int)
    assert len(found) < MESSAGES
    publisher.publish(String(data="last"))
    give_up, waiting = time.monotonic() + DEADLINE, subscription.take()
    while not waiting:
        assert time.monotonic() < give_up
        waiting = subscription.take()
    ((_, info),) = waiting
    assert before_ns <= info["received_timestamp"] <= time.time_ns()
    assert info["publication_sequence_number"] == MESSAGES + 1
