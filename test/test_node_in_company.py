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
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import ChaserState, PlanEvent
from ff_planner_msgs.msg import Scene as SceneMessage
from ff_planner_msgs.srv import PlanTrajectory
from quick_capture import resting_capture
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from ros_processes import (
    DEADLINE,
    Client,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
    wait_for,
)
from rosgraph_msgs.msg import Clock
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.cli import main
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.execution import Event
from ff_planner_ros.ros.process import ask

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SPEED, BEGINS = 10.0, 1000.0  # of the simulated clock, and where it begins [s]
TICK = 0.005  # [s] of the host


@pytest.mark.nightly
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


def test_a_node_that_is_renamed_and_remapped_works_and_its_bag_replays(tmp_path: Path) -> None:
    """As integrators place it among theirs; ROS remaps an action by the names of its parts."""
    parts = ("_action/send_goal", "_action/get_result", "_action/cancel_goal")
    names = {
        "__node": "planner_a",
        "__ns": "/servicer",
        "chaser_state": "/navigation/state",
        "obstacles": "/navigation/scene",
        "plan_trajectory": "/plan",
        "joint_trajectory": "/arm/joint_trajectory",
        "exchanges": "/log/exchanges",
        **{
            f"plan_trajectory_action/{part}": f"/mission/{part}"
            for part in (*parts, "_action/feedback", "_action/status")
        },
    }
    remapped = [word for one in names.items() for word in ("-r", "{}:={}".format(*one))]
    scene = Scene(resting_capture())
    patient = ("-p", "state_max_age:=3600.0")
    with private_domain(), running_planner(tmp_path, *patient, *remapped) as planner:
        with connected_client("/servicer", "planner_a") as client:
            states = client.node.create_publisher(ChaserState, "/navigation/state", 10)
            scenes = client.node.create_publisher(SceneMessage, "/navigation/scene", LATCHED)
            scenes.publish(scene.obstacles())
            client.node.create_timer(0.1, lambda: states.publish(scene.state(client.now_ns())))
            heard = client.hear(JointTrajectory, "/arm/joint_trajectory", LATCHED)
            asked = PlanTrajectory.Request(request=scene.request())
            status = Status.NO_STATE
            while status in (Status.NO_STATE, Status.NO_OBSTACLES):
                answer = client.call(PlanTrajectory, "/plan", asked).answer
                status = Status(answer.status.code)
            assert status is Status.SOLVED
            client.wait_until(lambda: heard, "the trajectory")
            action = ActionClient(client.node, PlanTrajectoryAction, "/mission")
            assert action.wait_for_server(DEADLINE)
            goal = PlanTrajectoryAction.Goal(request=scene.request())
            goal.request.plan_only = True
            handle = ask(client.executor, lambda: action.send_goal_async(goal)).result(DEADLINE)
            result = ask(client.executor, handle.get_result_async).result(DEADLINE)
            published = client.publish_plan(result.result.answer)
            assert published.code == Status.SOLVED
        assert planner.stop() == 0
    bag = read_bag(planner.bag)
    for name in ("/navigation/state", "/navigation/scene", "/arm/joint_trajectory"):
        assert bag[name]
    assert main(["replay", str(planner.bag)]) == 0


@pytest.mark.nightly
def test_a_node_that_is_started_twice_by_mistake_is_told_and_the_one_left_goes_on(
    tmp_path: Path,
) -> None:
    paths = [tmp_path / name for name in ("first", "again")]
    for path in paths:
        path.mkdir()
    with private_domain(), running_planner(paths[0]) as first:
        with running_planner(paths[1]) as again, connected_client() as client:
            client.wait_for_planner()
            for one in (first, again):
                wait_for(lambda one=one: "answered by /ff_planner, too" in one.log, "the error")
            answer = client.plan(Scene(resting_capture()).complete_request())
            assert answer.status.code == Status.SOLVED
            assert again.stop() == 0
        with connected_client() as client:
            health = client.hear(DiagnosticArray, "/diagnostics")
            client.wait_for_planner()
            client.wait_until(
                lambda: (
                    any("none in this namespace" in p.message for p in health[-1].status)
                    if health
                    else False
                ),
                "the first to be alone",
            )
            answer = client.plan(Scene(resting_capture()).complete_request())
            assert answer.status.code == Status.SOLVED
        assert first.stop() == 0
    assert [bool(read_bag(one.bag)) for one in (first, again)] == [True, True]


@pytest.mark.ci
def test_a_quality_of_service_is_offered_and_recorded_as_the_parameters_say(
    tmp_path: Path,
) -> None:
    settings = {
        "qos_overrides./joint_trajectory.publisher.reliability": "best_effort",
        "qos_overrides./joint_trajectory.publisher.durability": "volatile",
        "qos_overrides./chaser_state.subscription.reliability": "reliable",
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
