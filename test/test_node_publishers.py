"""Who publishes what the node plans from: two at once, in vain, or nobody any more."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import ChaserState, PlanAnswer
from ff_planner_msgs.msg import Scene as SceneMessage
from quick_capture import resting_capture
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_processes import (
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)

from ff_planner_ros.errors import Status

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
VOLATILE = QoSProfile(depth=1)


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    arguments = ("-p", "planning_lead_time:=60.0", "-p", "rates.diagnostics:=20.0")
    directory: Path = tmp_path_factory.mktemp("publishers")
    with private_domain(), running_planner(directory, *arguments) as planner:
        yield planner


@contextmanager
def publishing(name: str, kind: type, topic: str, qos: QoSProfile) -> Iterator[Publisher]:
    """Publish under a node's name."""
    node = rclpy.create_node(name)
    try:
        yield node.create_publisher(kind, topic, qos)
    finally:
        node.destroy_node()


def told(client: Client, heard: list[Any], part: str, words: str) -> None:
    """Wait until the diagnostics tell something of a part."""

    def is_told() -> bool:
        newest: DiagnosticArray = heard[-1]
        return any(one.name.endswith(part) and words in one.message for one in newest.status)

    client.wait_until(lambda: heard and is_told(), f"{part}: {words}")


@pytest.mark.ci
@pytest.mark.usefixtures("planner")
def test_a_publisher_with_another_quality_of_service_is_named_in_answer_and_diagnostics() -> None:
    """First of all, while there are no obstacles."""
    scene = Scene(resting_capture())
    with connected_client() as client:
        heard = client.hear(DiagnosticArray, "/diagnostics")
        client.wait_for_planner()
        with publishing("mapper", SceneMessage, "obstacles", VOLATILE) as mapper:
            mapper.publish(scene.obstacles())
            told(client, heard, "obstacles", "/mapper offers durability volatile")

            def named(answer: PlanAnswer) -> bool:
                client.publish_state(scene.state(client.now_ns()))
                message = answer.status.message
                return answer.status.code == Status.NO_OBSTACLES and "/mapper offers" in message

            client.plan_until(scene.request(), named)


@pytest.mark.law("NODE-06")
@pytest.mark.usefixtures("planner")
def test_a_second_publisher_is_refused_by_name_until_it_stops() -> None:
    """Though it says the same, or nothing; once it has ended, the graph forgets it at once."""
    scene = Scene(resting_capture())
    with connected_client() as client:
        heard = client.hear(DiagnosticArray, "/diagnostics")
        client.wait_for_planner()
        client.publish_obstacles(scene.obstacles())

        def after(status: Status) -> PlanAnswer:
            def is_there(answer: PlanAnswer) -> bool:
                client.publish_state(scene.state(client.now_ns()))
                return answer.status.code == status

            request = scene.request()
            request.plan_only = True
            return client.plan_until(request, is_there)

        after(Status.SOLVED)
        for name, kind, topic, part in (
            ("other_filter", ChaserState, "chaser_state", "chaser state"),
            ("mapper", SceneMessage, "obstacles", "obstacles"),
        ):
            with publishing(name, kind, topic, LATCHED):
                refused = after(Status.SEVERAL_PUBLISHERS)
                assert f"published by /{name} and /test_client" in refused.status.message
                assert refused.status.field == topic
                told(client, heard, part, f"/{name} and /test_client")
            after(Status.SOLVED)


@pytest.mark.usefixtures("planner")
def test_a_publisher_of_obstacles_that_is_gone_is_told() -> None:
    scene = Scene(resting_capture())
    with connected_client() as client:
        heard = client.hear(DiagnosticArray, "/diagnostics")
        client.wait_for_planner()
        client.node.destroy_publisher(client._obstacles)
        with publishing("mapper", SceneMessage, "obstacles", LATCHED) as mapper:
            mapper.publish(scene.obstacles())
            told(client, heard, "obstacles", "not stamped")
        told(client, heard, "obstacles", "their publisher is gone")
