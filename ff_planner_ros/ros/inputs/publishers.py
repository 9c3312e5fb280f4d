"""The publishers of the node's input topics, and why some of them cannot be heard."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ff_planner_ros.parameters.interfaces import QosParameters
from ff_planner_ros.ros.inputs.input_topics import INPUT_TOPICS
from ff_planner_ros.ros.messages.interfaces import type_name

if TYPE_CHECKING:  # what reads a bag has no middleware
    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

_UNNAMED = "a publisher without a name"  # that the middleware has not told of yet


class Publishers:
    """The publishers of a node's input topics, as the middleware lists them."""

    def __init__(self, node: Node, qos: QosParameters) -> None:
        """Look on behalf of a node whose subscriptions request `qos`."""
        self._node, self._qos = node, qos

    def heard(self, topic: str) -> list[str]:
        """Return the nodes of the publishers that this node hears, one per publisher, sorted."""
        return sorted(self.heard_by_id(topic).values())

    def heard_by_id(self, topic: str) -> dict[object, str]:
        """Return the same names by the identifier (GID) of each publisher."""
        return {
            bytes(one.endpoint_gid): _name(one)
            for one in self._infos(topic)
            if not self._why_unheard(topic, one)
        }

    def are_several(self, topic: str) -> bool:
        """Return whether a topic has two or more publishers, heard or not; takes microseconds."""
        return bool(self._node.count_publishers(self._node.resolve_topic_name(topic)) > 1)

    def unheard(self, topic: str) -> list[str]:
        """Return a phrase for each publisher that this node cannot hear: its node, and why."""
        return sorted(
            f"{_name(one)} {why}"
            for one in self._infos(topic)
            if (why := self._why_unheard(topic, one))
        )

    def _infos(self, topic: str) -> list[TopicEndpointInfo]:
        found: list[TopicEndpointInfo] = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(topic)
        )
        return found

    def _why_unheard(self, topic: str, one: TopicEndpointInfo) -> str:
        wanted = type_name(INPUT_TOPICS[topic].message_type)
        if one.topic_type != wanted:
            return f"publishes {one.topic_type}, this node needs {wanted}"
        return " and ".join(self._differences(topic, one))

    def _differences(self, topic: str, one: TopicEndpointInfo) -> Iterator[str]:
        asked = getattr(self._qos, topic)
        for policy, weak in (("reliability", "best_effort"), ("durability", "volatile")):
            offered = getattr(one.qos_profile, policy).name.lower()
            wanted = getattr(asked, policy)
            if offered == weak and wanted != weak:
                yield f"offers {policy} {offered}, this node needs {wanted} (qos.{topic}.{policy})"


def _name(one: TopicEndpointInfo) -> str:
    if not one.node_name or "UNKNOWN" in one.node_name:
        return _UNNAMED
    return f"{one.node_namespace.rstrip('/')}/{one.node_name}"
