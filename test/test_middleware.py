"""What the inputs ask ROS: who publishes a topic, and which of them are heard."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing

import pytest
import rclpy
from ff_planner_msgs.msg import Scene
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_processes import DEADLINE, private_domain

from ff_planner_ros.ros.inputs.middleware import Middleware
from ff_planner_ros.ros.topics import OBSTACLES

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def node() -> Iterator[Node]:
    with private_domain():
        rclpy.init(args=[])
        yield rclpy.create_node("hearer")
        rclpy.shutdown()


def published_by(node: Node, *others: Node) -> None:
    """Wait until the graph has one publisher of obstacles of each node."""
    give_up = time.monotonic() + DEADLINE
    while node.count_publishers("obstacles") != len(others):
        assert time.monotonic() < give_up


def test_publishers_that_are_heard_count_and_only_where_they_are_not_allowed(node: Node) -> None:
    mapper, operator, deaf = (rclpy.create_node(name) for name in ("mapper", "operator", "deaf"))
    with (
        closing(Middleware(node, allow_several=False)) as strict,
        closing(Middleware(node, allow_several=True)) as lenient,
    ):
        strict.subscribe(OBSTACLES)
        lenient.subscribe(OBSTACLES)
        deaf.create_publisher(Scene, "obstacles", QoSProfile(depth=1))
        mapper.create_publisher(Scene, "obstacles", LATCHED)
        published_by(node, deaf, mapper)
        assert strict.several("obstacles") == []
        assert strict.heard("obstacles") == ["/mapper"]
        (words,) = strict.unheard("obstacles")
        assert words.startswith("/deaf offers durability volatile")
        operator.create_publisher(Scene, "obstacles", LATCHED)
        published_by(node, deaf, mapper, operator)
        assert strict.several("obstacles") == ["/mapper", "/operator"]
        assert lenient.several("obstacles") == []
        operator.destroy_node()
        published_by(node, deaf, mapper)
        assert strict.several("obstacles") == []
