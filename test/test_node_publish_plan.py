"""A running node: plans that are asked for first and published later, and who asked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
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

from ff_planner_ros.bag.decoding import NANOSECONDS, nanoseconds
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.forward import carried_forward
from ff_planner_ros.planning.joint_motion import joint_motion
from ff_planner_ros.ros.messages.from_messages import plan_from_response
from ff_planner_ros.ros.messages.to_messages import state_message, time_message
from ff_planner_ros.runs.recorded_run import recorded_run
from ff_planner_ros.runs.replay import Verdict, replay

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


def state_in(made: PlanTrajectory.Response, since: float, turned: float = 0.0) -> Any:
    """Return the message of a state so long after a plan's first point [s], which it follows."""
    problem = SCENE.problem
    motion = joint_motion(plan_from_response(made).trajectory)
    state = carried_forward(problem.robot, problem.start, since, motion)
    wrong = state.angular_velocity_chaser_in_inertial + np.deg2rad(0.01)
    joints = state.joint_positions + turned
    state = replace(state, angular_velocity_chaser_in_inertial=wrong, joint_positions=joints)
    stamp_ns = nanoseconds(made.joint_trajectory.header.stamp) + round(since * NANOSECONDS)
    return state_message(state, problem.robot.joint_names, stamp_ns, "inertial")


def continuing(made: PlanTrajectory.Response, since: float, **changes: Any) -> dict[str, Any]:
    """Return what a request changes to continue a plan so long after its first point [s]."""
    start_ns = nanoseconds(made.joint_trajectory.header.stamp) + round(since * NANOSECONDS)
    fields = {"continue_plan": True, "duration": 0.0, "start_time": time_message(start_ns)}
    return fields | {"start_state": state_in(made, since - 0.2)} | changes


def test_a_plan_takes_over_from_the_one_that_runs(client: Client) -> None:
    first = client.plan(request(client))
    assert first.status.code == Status.SOLVED, first.status
    second = client.plan(request(client, **continuing(first, 3.0)))
    assert second.status.code == Status.SOLVED, second.status
    assert second.following == first.plan_id
    assert (second.joined_at, second.solver.starts) == (3.0, 1)
    start_ns = nanoseconds(second.joint_trajectory.header.stamp)
    assert second.delay == pytest.approx((start_ns - nanoseconds(second.taken_up)) / 1e9)
    assert second.duration == pytest.approx(first.duration - 3.0, abs=1e-12)
    joined = joint_motion(plan_from_response(first).trajectory).at(np.array([3.0]))
    point = second.joint_trajectory.points[0]
    for found, wanted in zip(
        (point.positions, point.velocities, point.accelerations), joined, strict=True
    ):
        assert found == pytest.approx(wanted[0], abs=1e-11)
    plan = published(client, second.plan_id)
    assert plan.joint_trajectory.header.stamp == second.joint_trajectory.header.stamp
    # The state is from before the second plan begins, while the first one still runs.
    third = client.plan(
        request(client, **continuing(second, 0.3, start_state=state_in(first, 2.9)))
    )
    assert third.status.code == Status.SOLVED, third.status
    assert third.following == second.plan_id

    ends = client.plan(request(client, **continuing(second, 6.9, start_state=state_in(first, 4.0))))
    assert ends.status.code == Status.PLAN_ENDING
    assert "0.100 s after the switch-over" in ends.status.message
    moved = client.plan(
        request(client, **continuing(first, 3.5, start_state=state_in(first, 3.4, turned=0.1)))
    )
    assert moved.status.code == Status.STATE_MOVED
    assert "more than replanning.max_joint_position, 0.02 rad" in moved.status.message
    early = request(client, continue_plan=True)
    early.start_state.header.stamp = time_message(client.now_ns())
    nothing = client.plan(early)
    assert nothing.status.code == Status.NO_ACTIVE_PLAN
    assert third.plan_id in nothing.status.message


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
    with open_bag(planner.bag) as opened:
        run = recorded_run(opened)
    continued = [one for one in run.requests if one.request and one.request.continue_plan]
    assert len(continued) == 5
    for one in continued:
        again = replay(one)
        assert again.verdict is Verdict.IDENTICAL, (one.name, again.words, again.differences)
        assert again.answer is not None
        assert one.response is not None
        assert again.answer.joint_trajectory == one.response.joint_trajectory
        assert again.answer.task_digest == one.response.task_digest
    assert asked_for.count(Status.SOLVED) == len(by_id)
    assert asked_for[-1] == Status.NOT_ACTIVE
