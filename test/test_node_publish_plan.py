"""A running node: plans that are asked for first and published later, and who asked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from ff_planner_msgs.srv import PlanTrajectory
from lifecycle_msgs.msg import Transition
from managed_node import Manager
from quick_capture import resting_capture
from ros_processes import (
    RESPONSE_SENT,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)

from ff_planner_ros.bag.decoding import nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.to_messages import time_message

# Plans start, and states are stamped, so far ahead that no machine is too slow [ns].
LEAD = 300_000_000_000
SCENE = Scene(resting_capture())


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    arguments = ("-p", "state_max_lead:=3600.0", "-p", "end_behaviour:=stop_joints")
    directory = tmp_path_factory.mktemp("publish_plan")
    with private_domain(), running_planner(directory, *arguments) as planner:
        yield planner


@pytest.fixture(scope="module")
def client(planner: PlannerProcess) -> Iterator[Client]:  # noqa: ARG001 (it must run)
    with connected_client() as client:
        client.wait_for_planner()
        yield client


def request(client: Client, **fields: Any) -> PlanTrajectory.Request:
    found = SCENE.complete_request()
    found.start_time = found.start_state.header.stamp = time_message(client.now_ns() + LEAD)
    for name, value in fields.items():
        setattr(found, name, value)
    return found


def published(client: Client, plan_id: str) -> Any:
    """Wait for a published plan and its trajectory, the last of all."""
    heard = client.received["published_plan"]
    client.wait_until(lambda: heard and heard[-1].plan_id == plan_id, plan_id)
    plan = heard[-1]
    client.wait_until(
        lambda: plan.joint_trajectory in client.received["joint_trajectory"], "its trajectory"
    )
    return plan


def test_a_plan_that_is_only_asked_for_goes_out_by_its_id(client: Client) -> None:
    before = [len(client.received[topic]) for topic in ("joint_trajectory", "published_plan")]
    asked = request(client, plan_only=True)
    made = client.plan(asked)
    assert made.status.code == Status.SOLVED, made.status
    other = client.publish_plan(f"{made.plan_id}0", asked_by="executive")
    assert other.code == Status.UNKNOWN_PLAN
    assert made.plan_id in other.message

    fitting = {"use_start_state": True, "start_state": asked.start_state}
    status = client.publish_plan(made.plan_id, asked_by="executive", **fitting)
    assert status.code == Status.SOLVED, status
    plan = published(client, made.plan_id)
    # It is the first that came on either topic: nothing was published when it was asked for.
    after = [len(client.received[topic]) for topic in ("joint_trajectory", "published_plan")]
    assert [n - b for n, b in zip(after, before, strict=True)] == [1, 1]
    assert plan.asked_by == "executive"
    assert plan.end_behaviour == "stop_joints"
    assert plan.start_time == made.joint_trajectory.header.stamp == asked.start_time
    assert plan.header.frame_id == "inertial"
    assert 0 < nanoseconds(plan.header.stamp) <= client.now_ns()
    assert [p.positions for p in plan.joint_trajectory.points] == [
        p.positions for p in made.joint_trajectory.points
    ]
    again = client.publish_plan(made.plan_id, **fitting)
    assert again.code == Status.UNKNOWN_PLAN
    assert "published already" in again.message


def test_a_plan_that_is_published_at_once_says_who_asked(client: Client) -> None:
    for name, said in (("", "plan_trajectory"), ("director", "director")):
        made = client.plan(request(client, asked_by=name))
        assert made.status.code == Status.SOLVED, made.status
        assert published(client, made.plan_id).asked_by == said
    _, result = client.send_goal(request(client)).result()
    assert published(client, result.plan_id).asked_by == "plan_trajectory_action"


def test_a_plan_goes_out_only_from_where_it_begins(client: Client) -> None:
    asked = request(client, plan_only=True)
    made = client.plan(asked)
    assert made.status.code == Status.SOLVED, made.status
    # Nobody publishes states here: what is not measured cannot be compared.
    assert client.publish_plan(made.plan_id).code == Status.NO_STATE
    state = SCENE.state(0)
    state.header.stamp = asked.start_time
    state.pose.position.x += 0.05
    moved = client.publish_plan(made.plan_id, use_start_state=True, start_state=state)
    assert moved.code == Status.STATE_MOVED
    assert "position by 0.05 m, more than publication.max_position, 0.02 m" in moved.message
    state.pose.position.x -= 0.05
    status = client.publish_plan(made.plan_id, use_start_state=True, start_state=state)
    assert status.code == Status.SOLVED, status


def test_the_bag_has_every_publication_and_who_asked_for_it(
    client: Client, planner: PlannerProcess
) -> None:
    """The last test: it ends the node's session."""
    heard = client.received["published_plan"]
    made = client.plan(request(client, plan_only=True, asked_by="nobody"))
    manager = Manager(client)
    assert manager.change(Transition.TRANSITION_DEACTIVATE) == [True]
    assert client.publish_plan(made.plan_id).code == Status.NOT_ACTIVE
    assert manager.change(Transition.TRANSITION_CLEANUP) == [True]
    bag = read_bag(planner.bag)
    recorded = [(one.plan_id, one.asked_by) for one in bag["/published_plan"]]
    assert recorded == [(one.plan_id, one.asked_by) for one in heard]
    asked_for = [
        event.response[0].status.code
        for event in bag["/ff_planner/publish_plan/_service_event"]
        if event.info.event_type == RESPONSE_SENT
    ]
    by_id = [plan for plan in heard if plan.asked_by in ("executive", "~/publish_plan")]
    assert asked_for.count(Status.SOLVED) == len(by_id)
    assert asked_for[-1] == Status.NOT_ACTIVE
