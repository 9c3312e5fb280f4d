"""Finds other planners that serve the same requests, any of which might answer."""

from __future__ import annotations

from rclpy.node import Node

from ff_planner_ros.ros.messages.interfaces import ACTION, SERVICE

_UNNAMED = "another node"  # that the middleware has not told of yet


def namesakes(node: Node) -> list[str]:
    """Return the names of the other nodes that serve this node's service or action, sorted.

    Another node of the same name is included. A crashed node counts until the middleware misses it,
    with Fast DDS for 20 s.
    """
    services = {node.resolve_service_name(SERVICE)}
    services.add(f"{node.resolve_service_name(ACTION)}/_action/send_goal")
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
    return sorted(names) or [_UNNAMED] * others


def _served(node: Node, name: str, namespace: str) -> set[str]:
    try:
        found = node.get_service_names_and_types_by_node(name, namespace)
    except RuntimeError:  # it has gone meanwhile
        return set()
    return {service for service, _ in found}
