"""Quality of service of the node's topics: the table's, or what `qos_overrides.*` say instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from ff_planner_ros.common.forms import Form, a_whole_number, a_word
from ff_planner_ros.ros.topics import INPUTS, OUTPUTS, SERVICE, Endpoint, override

# rclpy declares them with the endpoint: `qos_overrides./TOPIC.publisher.reliability`, and so on.
OVERRIDES = QoSOverridingOptions(
    (QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY, QoSPolicyKind.DEPTH)
)
_FORMS = {
    "reliability": a_word(("best_effort", "reliable")),
    "durability": a_word(("volatile", "transient_local")),
    "depth": a_whole_number(1, 10_000),
}


def qos_profile(endpoint: Endpoint) -> QoSProfile:
    """Return a topic's quality of service without overrides, of its own: rclpy changes it."""
    return QoSProfile(
        reliability=ReliabilityPolicy[endpoint.qos.reliability.upper()],
        durability=DurabilityPolicy[endpoint.qos.durability.upper()],
        depth=endpoint.qos.depth,
    )


REQUEST_QOS = qos_profile(SERVICE)


def create_publisher(node: Node, endpoint: Endpoint) -> Publisher:
    """Create the publisher of a topic, which is heard whatever state the node is in."""
    return node.create_publisher(
        endpoint.message_type,
        endpoint.name,
        qos_profile(endpoint),
        qos_overriding_options=OVERRIDES,
    )


def create_lifecycle_publisher(node: LifecycleNode, endpoint: Endpoint) -> LifecyclePublisher:
    """Create the publisher of a topic, which is silent until the node is active."""
    made: LifecyclePublisher = node.create_lifecycle_publisher(
        endpoint.message_type,
        endpoint.name,
        qos_profile(endpoint),
        qos_overriding_options=OVERRIDES,
    )
    return made


@contextmanager
def serving(node: Node, endpoint: Endpoint, answer: Callable[..., Any]) -> Iterator[None]:
    """Offer a service as long as the context lasts, apart from all other callbacks."""
    group = MutuallyExclusiveCallbackGroup()
    service = node.create_service(
        endpoint.message_type,
        endpoint.name,
        answer,
        qos_profile=qos_profile(endpoint),
        callback_group=group,
    )
    try:
        yield
    finally:
        node.destroy_service(service)


def overridable(node: Node) -> dict[str, Form]:
    """Return the form of every parameter that may override a quality of service, by its name.

    rclpy would ignore an unknown name, and learn of a wrong value when the node is configured.
    """
    return {
        override(node.resolve_topic_name(topic.name), kind, policy): form
        for kind, topics in (("subscription", INPUTS), ("publisher", OUTPUTS))
        for topic in topics
        for policy, form in _FORMS.items()
    }
