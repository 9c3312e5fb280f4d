"""What happens around a planner process while it plans, and when something in it breaks."""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from quick_capture import resting_capture
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    answers_in,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)

from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.to_messages import time_message

ARGUMENTS = (
    *("-p", "state_max_age:=3600.0", "-p", "bag.flush_interval:=0.05"),
    *("-p", "planning_lead_time:=60.0"),
)


@pytest.mark.nightly
def test_while_a_plan_is_made_every_state_is_taken_and_recorded(
    tmp_path: Path,
) -> None:
    scene = Scene(resting_capture())
    with private_domain(), running_planner(tmp_path, *ARGUMENTS) as planner:
        with connected_client() as client:
            first = _ready(client, scene)
            soon = scene.request()

            def solved(answer: PlanAnswer) -> bool:
                leads.append(2 * leads[-1])  # for a machine that has it ready too late
                soon.start_time = time_message(client.now_ns() + leads[-1])
                return answer.status.code == Status.SOLVED

            leads = [2_000_000_000]
            soon.start_time = time_message(client.now_ns() + leads[-1])
            client.plan_until(soon, solved)
            answer = _ask_frozen(client, planner, scene.request())
            published, before = [], len(_states_on_disk(planner.bag))
            give_up = time.monotonic() + DEADLINE
            while len(_states_on_disk(planner.bag)) < before + 20:
                assert time.monotonic() < give_up, "the recorder waits for the planner"
                published.append(scene.state(client.now_ns()))
                client.publish_states_at(50.0, published[-1:])
            heard = len(client.received["predicted_chaser_pose"])
            client.wait_until(
                lambda: len(client.received["predicted_chaser_pose"]) >= heard + 3,
                "the stream of poses of the plan before",
            )
            planner.send_to_solvers(signal.SIGCONT)
            made = answer()
            assert made.status.code == Status.SOLVED
            assert made.inputs.state_stamp == first
            newest = client.plan(scene.request())
            assert newest.inputs.state_stamp == published[-1].header.stamp
        assert planner.stop() == 0
    recorded = [
        (message.header.stamp.sec, message.header.stamp.nanosec)
        for message in read_bag(planner.bag)["/chaser_state"]
    ]
    expected = [(m.header.stamp.sec, m.header.stamp.nanosec) for m in published]
    assert recorded[-len(expected) :] == expected


def test_a_node_that_is_stopped_while_planning_answers_and_completes_its_bag(
    tmp_path: Path,
) -> None:
    scene = Scene(resting_capture())
    with (
        private_domain(),
        running_planner(tmp_path, *ARGUMENTS) as planner,
        connected_client() as client,
    ):
        _ready(client, scene)
        answer = _ask_frozen(client, planner, scene.request())
        assert planner.stop(signal.SIGTERM) == 0
        assert answer().status.code == Status.SHUT_DOWN
    told = answers_in(read_bag(planner.bag))[-1].status
    assert told.code == Status.SHUT_DOWN
    assert "shut down" in told.message


@pytest.mark.ci
def test_a_node_that_ends_gives_up_its_goal_and_has_all_goals_and_answers_in_its_bag(
    tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    scene, many = Scene(resting_capture()), times(50, 200)
    long = scene.complete_request()
    long.search.points = 5000
    with private_domain(), running_planner(tmp_path, *ARGUMENTS) as planner:
        with connected_client() as client:
            client.wait_for_planner()
            for _ in range(many):
                cancelled = client.send_goal(long)
                assert cancelled.progress.wait(DEADLINE)
                assert cancelled.cancel()
                assert cancelled.result()[1].status.code == Status.CANCELLED
            status, solved = client.send_goal(scene.complete_request()).result()
            assert status == GoalStatus.STATUS_SUCCEEDED
            last = client.send_goal(long)
            assert last.progress.wait(DEADLINE)
            assert planner.stop(signal.SIGTERM) == 0
        bag = read_bag(planner.bag)
    goals = [one.plan_id for one in bag["/exchanges"] if one.event == "received"]
    answers = answers_in(bag)
    assert len(set(goals)) == len(goals) == many + 2
    assert [answer.plan_id for answer in answers] == goals
    *_, recorded, given_up = answers
    assert recorded.plan_id == solved.plan_id
    points = [list(point.positions) for point in recorded.plans[0].joint_trajectory.points]
    assert points == [list(point.positions) for point in solved.plans[0].joint_trajectory.points]
    assert given_up.status.code == Status.SHUT_DOWN


@pytest.mark.ci
def test_a_node_that_is_killed_takes_its_solvers_along(tmp_path: Path) -> None:
    with private_domain(), running_planner(tmp_path) as planner, connected_client() as client:
        client.wait_for_planner()
        solvers = [os.pidfd_open(number) for number in planner.solvers]
        assert solvers
        planner.process.kill()
        for solver in solvers:
            ended, _, _ = select.select([solver], [], [], DEADLINE)
            os.close(solver)
            assert ended


def _ready(client: Client, scene: Scene) -> Any:
    """Publish state and obstacles, wait until they are there, and return the state's stamp."""
    client.publish_obstacles(scene.obstacles())
    client.wait_for_planner()
    state = scene.state(client.now_ns())
    client.publish_and_wait(state)
    return state.header.stamp


def _ask_frozen(
    client: Client, planner: PlannerProcess, request: PlanRequest
) -> Callable[[], PlanAnswer]:
    """Freeze the solvers, ask, and return the answer's promise once the planner has the request."""
    heard = client.received["exchanges"]
    client.plan_until(PlanRequest(), lambda _: bool(heard))
    planner.send_to_solvers(signal.SIGSTOP)
    answer = client.send(request)
    client.wait_until(
        lambda: heard[-1].event == "received" and heard[-1].request[0] == request,
        "the request's arrival",
    )
    return answer


def _states_on_disk(bag: Path) -> list[Message]:
    """Return the chaser states that a crash of this moment would leave behind."""
    (file,) = bag.glob("*.mcap")
    channels: dict[int, str] = {}
    found: list[Message] = []
    with file.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message) and channels[record.channel_id] == "/chaser_state":
                    found.append(record)
        except McapError:  # the end of what was flushed
            pass
    return found
