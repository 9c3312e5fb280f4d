"""The running node against the table of interfaces.md and the policy, and against its bag."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from rclpy.action.graph import get_action_server_names_and_types_by_node
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.topic_endpoint_info import TopicEndpointInfo
from ros_processes import Client, connected_client, private_domain, read_bag, running_planner
from security_policy import (
    EXECUTE,
    NODE,
    PUBLISH,
    RECORDER,
    REPLY,
    REQUEST,
    SUBSCRIBE,
    Rule,
    profiles,
)

INTERFACES = Path(__file__).resolve().parents[1] / "docs" / "reference" / "interfaces.md"
ROW = re.compile(
    r"^\| (subscribes|publishes|service|action) \| `([\w/~]+)` \| `([\w/]+)` \| ([\w, -]*) \|", re.M
)
DISCOVERY = 120.0  # [s] what the graph does not tell by then it never will
# What every node has, and what every lifecycle node has.
OF_ROS = re.compile(
    r"^/(rosout|parameter_events|clock)$|/_"
    r"|^/ff_planner/(change_state|transition_event|[gs]et_\w+|list_parameters|describe_parameters)$"
)


class Interface(NamedTuple):
    """One row of the table."""

    direction: str
    name: str
    type: str
    qos: str


def _qos(endpoints: list[TopicEndpointInfo]) -> str:
    (qos,) = {
        (at.qos_profile.reliability.name, at.qos_profile.durability.name)
        for at in endpoints
        if at.node_name == "ff_planner"
    }
    return ", ".join(qos).lower().replace("_", " ")


def _interfaces(node: Node) -> set[Interface]:
    """What a planner in the root namespace has, as the graph tells it."""
    found = set()
    topics: tuple[tuple[str, Any, Any], ...] = (
        (
            "publishes",
            node.get_publisher_names_and_types_by_node,
            node.get_publishers_info_by_topic,
        ),
        (
            "subscribes",
            node.get_subscriber_names_and_types_by_node,
            node.get_subscriptions_info_by_topic,
        ),
    )
    for direction, names_and_types, endpoints in topics:
        for name, types in names_and_types("ff_planner", "/"):
            if not OF_ROS.search(name):
                found |= {Interface(direction, name, t, _qos(endpoints(name))) for t in types}
    services = node.get_service_names_and_types_by_node("ff_planner", "/")
    actions = get_action_server_names_and_types_by_node(node, "ff_planner", "/")
    for direction, all_of_them in (("service", services), ("action", actions)):
        for name, types in all_of_them:
            if not OF_ROS.search(name):
                found |= {Interface(direction, name, t, "") for t in types}
    return found


def _does(node: Node, name: str) -> set[Rule]:
    """What a node in the root namespace does, as the graph tells it and a policy has it."""
    found = {
        Rule(EXECUTE, one) for one, _ in get_action_server_names_and_types_by_node(node, name, "/")
    }
    actions = tuple(f"{one.name}/_action/" for one in found)
    for what, names_and_types in (
        (PUBLISH, node.get_publisher_names_and_types_by_node),
        (SUBSCRIBE, node.get_subscriber_names_and_types_by_node),
        (REPLY, node.get_service_names_and_types_by_node),
        (REQUEST, node.get_client_names_and_types_by_node),
    ):
        names = {one for one, _ in names_and_types(name, "/")}
        # What makes an action is allowed with the action.
        found |= {Rule(what, one) for one in names if not one.startswith(actions or ("-",))}
    return found


def _allowed(name: str) -> set[Rule]:
    """What the policy lets a node in the root namespace do."""
    return {
        rule._replace(name=f"/{rule.name.replace('~', name).lstrip('/')}")
        for rule in profiles()[name]
    }


def _seen(client: Client, wanted: set[Interface]) -> set[Interface]:
    """Ask the graph until it tells all that is wanted, or time is up."""
    client.wait_for_planner()
    give_up = time.monotonic() + DISCOVERY
    seen: set[Interface] = set()
    while not wanted <= seen and time.monotonic() < give_up:
        with suppress(NodeNameNonExistentError):  # the graph does not know the planner's name yet
            seen = _interfaces(client.node)
    return seen


# What exchanges and the attachment robot.urdf have, and what is of ROS itself.
NOT_RECORDED = {
    "/robot_model",
    "/parameter_events",
    "/plan_trajectory_action/_action/feedback",
    "/plan_trajectory_action/_action/status",
}


def _topics(client: Client) -> set[str]:
    """Every topic that the planner publishes or subscribes to, as the graph tells it."""
    node = client.node
    return {
        name
        for names_and_types in (
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
        )
        for name, _ in names_and_types("ff_planner", "/")
    }


@pytest.mark.parametrize(
    ("source", "simulated_time"),
    [("chaser_state", "false"), pytest.param("odometry", "true", marks=pytest.mark.ci)],
)
def test_the_page_lists_every_interface_of_the_node_and_its_bag_has_every_topic(
    tmp_path: Path, source: str, simulated_time: str
) -> None:
    rows = {Interface(*row) for row in ROW.findall(INTERFACES.read_text(encoding="utf-8"))}
    absolute = {
        row._replace(
            name=f"/{row.name.replace('~', 'ff_planner').lstrip('/')}", qos=row.qos.strip()
        )
        for row in rows
    }
    inputs = {
        "chaser_state": {"/chaser_state"},
        "odometry": {"/odometry", "/joint_states"},
    }
    other = "odometry" if source == "chaser_state" else "chaser_state"
    expected = {row for row in absolute if row.name not in inputs[other]}
    not_here = inputs[other] | ({"/clock"} if simulated_time == "false" else set())
    allowed = {
        name: {rule for rule in _allowed(name) if rule.name not in not_here}
        for name in (NODE, RECORDER)
    }
    arguments = ("-p", f"state_source:={source}", "-p", f"use_sim_time:={simulated_time}")
    with (
        private_domain(),
        running_planner(tmp_path, *arguments) as planner,
        connected_client() as client,
    ):
        found = _seen(client, expected)
        topics = _topics(client)
        give_up = time.monotonic() + DISCOVERY
        while True:
            does = {name: _does(client.node, name) for name in allowed}
            if does == allowed or time.monotonic() > give_up:
                break
        assert planner.stop() == 0
    assert found == expected
    assert does == allowed, "run tools/security_policy.py"
    recorded = set(read_bag(planner.bag))
    assert topics - recorded == NOT_RECORDED
    assert recorded <= topics
    assert ("/clock" in recorded) == (simulated_time == "true")
