"""A running node among others: two in one domain, other qualities of service, a fast clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import PlanEvent
from quick_capture import resting_capture
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from ros_processes import (
    Client,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from rosgraph_msgs.msg import Clock

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.execution import Event

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SPEED, BEGINS = 10.0, 1000.0  # of the simulated clock, and where it begins [s]
TICK = 0.005  # [s] of the host


@pytest.mark.ci
def test_two_planners_in_one_domain_keep_to_their_namespaces(tmp_path: Path) -> None:
    scene, paths = Scene(resting_capture()), [tmp_path / name for name in ("one", "two")]
    for path in paths:
        path.mkdir()
    with (
        private_domain(),
        running_planner(paths[0], "-r", "__ns:=/one") as one,
        running_planner(paths[1], "-r", "__ns:=/two") as two,
    ):
        with connected_client("/one", "/one/ff_planner") as client:
            health = client.hear(DiagnosticArray, "/diagnostics")
            client.wait_for_planner()
            answer = client.plan(scene.complete_request())
            assert answer.status.code == Status.SOLVED
            client.wait_until(lambda: client.received["joint_trajectory"], "the trajectory")

            def told() -> set[str]:
                named = (part for one in health for part in one.status)
                return {part.name for part in named if "none in this namespace" in part.message}

            both = {f"/{name}/ff_planner: other planners" for name in ("one", "two")}
            client.wait_until(lambda: told() >= both, "both planners to see no other one")
        assert [planner.stop() for planner in (one, two)] == [0, 0]
        bags = [read_bag(planner.bag) for planner in (one, two)]
    assert bags[0]["/one/joint_trajectory"]
    assert not [topic for topic in bags[1] if topic.startswith("/one/")]
    assert not bags[1]["/two/joint_trajectory"]


def test_a_quality_of_service_is_offered_and_recorded_as_the_parameters_say(
    tmp_path: Path,
) -> None:
    settings = {
        "qos.joint_trajectory.reliability": "best_effort",
        "qos_overrides./joint_trajectory.publisher.durability": "volatile",  # in ROS's words
        "qos.chaser_state.reliability": "reliable",
    }
    arguments = [word for item in settings.items() for word in ("-p", "{}:={}".format(*item))]
    with private_domain(), running_planner(tmp_path, *arguments) as planner:
        with connected_client() as client:
            client.wait_for_planner()
            node = client.node

            def offered() -> list[TopicEndpointInfo]:
                return node.get_publishers_info_by_topic("joint_trajectory")

            def asked() -> list[str]:
                return [
                    one.qos_profile.reliability.name
                    for one in node.get_subscriptions_info_by_topic("chaser_state")
                    if one.node_name == "ff_planner"
                ]

            client.wait_until(lambda: offered() and asked(), "publisher and subscription")
            (profile,), wanted = [one.qos_profile for one in offered()], asked()
            answer = client.plan(Scene(resting_capture()).complete_request())
            assert answer.status.code == Status.SOLVED
        assert planner.stop() == 0
    assert (profile.reliability.name, profile.durability.name) == ("BEST_EFFORT", "VOLATILE")
    assert wanted == ["RELIABLE"]
    assert read_bag(planner.bag)["/joint_trajectory"]


@contextmanager
def fast_clock(client: Client) -> Iterator[None]:
    """A clock that goes at SPEED, as long as the context lasts."""
    publisher = client.node.create_publisher(Clock, "/clock", 10)
    stopped, begun = threading.Event(), time.monotonic()

    def tick() -> None:
        while not stopped.wait(TICK):
            now = BEGINS + SPEED * (time.monotonic() - begun)
            stamp = Time(sec=int(now), nanosec=int(now % 1.0 * NANOSECONDS))
            publisher.publish(Clock(clock=stamp))

    thread = threading.Thread(target=tick, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


@pytest.mark.ci
@pytest.mark.parametrize("lead", [30.0])
def test_with_a_clock_ten_times_as_fast_a_plan_begins_and_ends_by_that_clock(
    tmp_path: Path, lead: float
) -> None:
    """A plan of 10 s with a tail of 2 s: at its goal it is 12 s in simulated time at least."""
    arguments = (
        *("-p", "use_sim_time:=true", "-p", "state_future_tolerance:=3600.0"),
        *("-p", f"planning_lead_time:={lead}", "-p", "end_behaviour:=stop_joints"),
    )
    scene = Scene(resting_capture())
    with private_domain(), running_planner(tmp_path, *arguments) as planner:
        with connected_client() as client:
            events = client.hear(PlanEvent, "plan_events", LATCHED)
            with fast_clock(client):
                client.wait_for_planner()

                def answered(answer: object) -> bool:
                    return answer.status.code == Status.SOLVED  # type: ignore[attr-defined]

                request = scene.complete_request()
                request.start_state[0].header.stamp = time_message(0)  # as if measured now
                answer = client.plan_until(request, answered)
                client.wait_until(
                    lambda: [one for one in events if one.event == Event.AT_GOAL], "the goal"
                )
        assert planner.stop() == 0
    (plan,) = answer.plans
    start_ns = nanoseconds(plan.joint_trajectory.header.stamp)
    goal_ns = start_ns + round(plan.duration * NANOSECONDS)
    received_ns = nanoseconds(answer.inputs.received_stamp)
    assert start_ns - received_ns == lead * NANOSECONDS
    told = {
        Event(one.event): nanoseconds(one.header.stamp)
        for one in events
        if one.plan_id == answer.plan_id
    }
    assert list(told) == [Event.PUBLISHED, Event.STARTED, Event.AT_GOAL]
    assert BEGINS * NANOSECONDS < received_ns <= told[Event.PUBLISHED] < start_ns
    assert start_ns <= told[Event.STARTED] < goal_ns <= told[Event.AT_GOAL]
    frames = read_bag(planner.bag)["/tf"]
    stamps = {
        nanoseconds(one.header.stamp)
        for message in frames
        for one in message.transforms
        if one.child_frame_id == "predicted/chaser"
    }
    assert any(start_ns <= stamp <= goal_ns for stamp in stamps)
