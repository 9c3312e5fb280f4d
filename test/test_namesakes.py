"""Another planner in the same namespace is seen."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
import rclpy
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.node import Node
from ros_processes import DEADLINE, private_domain

from ff_planner_ros.ros.inputs.middleware import namesakes


@pytest.fixture(autouse=True)
def middleware() -> Iterator[None]:
    with private_domain():
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


def planner(name: str, namespace: str) -> Node:
    node = rclpy.create_node(name, namespace=namespace, use_global_arguments=False)
    node.create_service(PlanTrajectory, "plan_trajectory", lambda *_: None)
    return node


def wait_for(node: Node, expected: list[str]) -> None:
    """Wait until the middleware has told a node of the others."""
    give_up = time.monotonic() + DEADLINE
    while (found := namesakes(node)) != expected:
        assert time.monotonic() < give_up, found


@pytest.mark.parametrize("other", ["ff_planner", "spare"])
def test_each_of_two_planners_in_one_namespace_is_told_of_the_other(other: str) -> None:
    ours, theirs = planner("ff_planner", "/servicer"), planner(other, "/servicer")
    wait_for(ours, [f"/servicer/{other}"])
    wait_for(theirs, ["/servicer/ff_planner"])
    theirs.destroy_node()
    wait_for(ours, [])


def test_a_planner_in_another_namespace_is_none() -> None:
    ours, _ = planner("ff_planner", "/servicer"), planner("ff_planner", "/client")
    beside = planner("spare", "/servicer")
    wait_for(ours, ["/servicer/spare"])
    beside.destroy_node()
    wait_for(ours, [])
