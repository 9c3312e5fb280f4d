"""What the graph says of inputs and of other planners; subscriptions, and the node's clock."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rclpy.clock import ROSClock

from ff_planner_ros.ros.inputs.raw_subscription import RawSubscription
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.qos import OVERRIDES, qos_profile
from ff_planner_ros.ros.topics import ACTION, INPUTS, SERVICE, Endpoint, override

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

_UNNAMED = "a publisher without a name"  # that the middleware has not told of yet


class Middleware:
    """A node's subscriptions to its input topics, their publishers, and its clock."""

    def __init__(self, node: Node, allow_several: bool) -> None:
        """Begin without subscriptions.

        Args:
            allow_several: Whether a topic may have several publishers.
        """
        self._node, self._allow_several = node, allow_several
        self._subscriptions = dict[str, RawSubscription]()

    def subscribe(self, topic: Endpoint) -> RawSubscription:
        """Subscribe to a topic, until closed."""
        subscription = RawSubscription(
            self._node, topic.message_type, topic.name, qos_profile(topic), OVERRIDES
        )
        self._subscriptions[topic.name] = subscription
        return subscription

    def close(self) -> None:
        """Subscribe to nothing any more."""
        for one in self._subscriptions.values():
            one.close()

    @property
    def now_ns(self) -> int:
        """The node's time [ns]."""
        return int(self._node.get_clock().now().nanoseconds)

    @property
    def time_is_simulated(self) -> bool:
        """Whether the node's time is that of `/clock`, and not the host's."""
        clock = self._node.get_clock()
        return isinstance(clock, ROSClock) and clock.ros_time_is_active

    def heard(self, topic: str) -> list[str]:
        """Return the nodes of the publishers that this node hears, one per publisher, sorted."""
        return sorted(_name(one) for one in self._infos(topic) if not self._why_unheard(topic, one))

    def several(self, topic: str) -> list[str]:
        """Return the nodes of a topic's publishers, if there are more than the parameters allow.

        To ask takes microseconds where there is one.
        """
        if self._allow_several:
            return []
        if self._node.count_publishers(self._node.resolve_topic_name(topic)) < 2:
            return []
        names = self.heard(topic)
        return names if len(names) > 1 else []

    def unheard(self, topic: str) -> list[str]:
        """Return a phrase for each publisher that this node cannot hear: its node, and why."""
        return sorted(
            f"{_name(one)} {why}"
            for one in self._infos(topic)
            if (why := self._why_unheard(topic, one))
        )

    def unheard_words(self, topic: str) -> str:
        """Return the end of a refusal that names publishers which this node cannot hear."""
        return "".join(f"; {words}: it is not heard" for words in self.unheard(topic))

    def _infos(self, topic: str) -> list[TopicEndpointInfo]:
        found: list[TopicEndpointInfo] = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(topic)
        )
        return found

    def _why_unheard(self, topic: str, one: TopicEndpointInfo) -> str:
        wanted = next(type_name(one.message_type) for one in INPUTS if one.name == topic)
        if one.topic_type != wanted:
            return f"publishes {one.topic_type}, this node needs {wanted}"
        return " and ".join(self._differences(topic, one))

    def _differences(self, topic: str, one: TopicEndpointInfo) -> Iterator[str]:
        asked, name = self._subscriptions[topic].qos, self._node.resolve_topic_name(topic)
        for policy, weak in (("reliability", "best_effort"), ("durability", "volatile")):
            offered = getattr(one.qos_profile, policy).name.lower()
            wanted = getattr(asked, policy).name.lower()
            if offered == weak and wanted != weak:
                parameter = override(name, "subscription", policy)
                yield f"offers {policy} {offered}, this node needs {wanted} ({parameter})"


def _name(one: TopicEndpointInfo) -> str:
    if not one.node_name or "UNKNOWN" in one.node_name:
        return _UNNAMED
    return f"{one.node_namespace.rstrip('/')}/{one.node_name}"


def namesakes(node: Node) -> list[str]:
    """Return the names of the other nodes that serve this node's service or action, sorted.

    Another node of the same name is included. A crashed node counts until the middleware misses it,
    with Fast DDS for 20 s.
    """
    services = {node.resolve_service_name(SERVICE.name)}
    services.add(node.resolve_service_name(f"{ACTION.name}/_action/send_goal"))
    others = max(node.count_services(service) for service in services) - 1
    if others <= 0:
        return []
    names = [
        f"{namespace.rstrip('/')}/{name}"
        for name, namespace in node.get_node_names_and_namespaces()
        if services & _served(node, name, namespace)
    ]
    if node.get_fully_qualified_name() in names:
        names.remove(node.get_fully_qualified_name())
    return sorted(names) or ["another node"] * others  # that the middleware has not told of yet


def _served(node: Node, name: str, namespace: str) -> set[str]:
    try:
        found = node.get_service_names_and_types_by_node(name, namespace)
    except RuntimeError:  # it has gone meanwhile
        return set()
    return {service for service, _ in found}
