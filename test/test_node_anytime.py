"""Budgets and cancels on a busy machine: what the clock decided replays identically."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from ff_planner_msgs.msg import PlanRequest
from recorded_requests import replays_of
from robots import LEMUR_SCENARIO
from ros_processes import (
    DEADLINE,
    Client,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)

from ff_planner_ros.bag.exchanges import exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import BagError, EndedBy, Status
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.runs.replay import Verdict

SEED = 31
SCENE = Scene(load_scenario(LEMUR_SCENARIO))
# Plans start, and states are stamped, so far ahead that no machine is too slow [ns].
LEAD = 300_000_000_000


def least_attitude(client: Client) -> PlanRequest:
    request = SCENE.complete_request()
    request.start_time = request.start_state[0].header.stamp = time_message(client.now_ns() + LEAD)
    request.objective.joint_path_length, request.objective.chaser_attitude = 0.0, 1.0
    return request


def busy() -> None:
    while True:
        np.linalg.eigvals(np.ones((60, 60)))


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    others = [multiprocessing.Process(target=busy, daemon=True) for _ in range(count)]
    for one in others:
        one.start()
    try:
        yield
    finally:
        for one in others:
            one.kill()


def all_recorded(bag: Path, asked: int) -> bool:
    """Whether the bag of a node that runs has every answer."""
    try:
        with open_bag(bag) as opened:
            requests = list(exchanges(opened))
    except BagError:
        return False
    return len(requests) == asked and all(one.answer is not None for one in requests)


def cancelled_for_the_best(client: Client) -> None:
    """A goal that is cancelled is answered with the best plan until then, and its effort."""
    request = least_attitude(client)
    request.on_cancel = "best"
    goal = client.send_goal(request)
    while not any(feedback.best for feedback in goal.feedback):
        assert goal.progress.wait(DEADLINE), "no feedback"
        goal.progress.clear()
    assert goal.cancel()
    status, result = goal.result()
    assert (status, result.status.code) == (GoalStatus.STATUS_SUCCEEDED, Status.SOLVED)
    assert result.solver.ended_by == EndedBy.CANCEL
    effort = result.plans[0].effort
    assert effort > 1
    assert result.status.message == "the request was cancelled: the best plan so far"
    first = next(f.best[0] for f in goal.feedback if f.best)
    assert result.metrics[0].max_chaser_euler <= first.max_chaser_euler
    request.search.effort = effort
    again = client.plan(request)
    assert (again.plans[0].effort, again.solver.ended_by) == (effort, EndedBy.EFFORT)
    assert again.task_digest == result.task_digest
    assert again.plans[0].joint_trajectory == result.plans[0].joint_trajectory


@pytest.mark.ci
def test_the_attitude_is_looked_for_no_longer_than_its_own_budget(tmp_path: Path) -> None:
    """And not less: the first plan comes however short that budget is."""
    options = ("-p", "state_future_tolerance:=3600.0", "-p", "attitude_time_budget:=0.001")
    with private_domain(), running_planner(tmp_path, *options), connected_client() as client:
        client.wait_for_planner()
        answer = client.plan(least_attitude(client))
        assert (answer.status.code, answer.solver.ended_by) == (Status.SOLVED, EndedBy.DEADLINE)
        assert "the time budget of 0.001 s is used up" in answer.status.message


@pytest.mark.ci
@pytest.mark.law("NODE-11")
def test_what_the_clock_or_a_client_ends_replays_identically(
    tmp_path: Path, times: Callable[[int, int], int]
) -> None:
    """Some are refused for lack of time, some get the best until then, some come to the end."""
    rng, asked = np.random.default_rng(SEED), times(12, 200)
    ends = list[tuple[int, str]]()
    with private_domain():
        ahead = ("-p", "state_future_tolerance:=3600.0")
        with running_planner(tmp_path, *ahead) as planner, connected_client() as client:
            client.wait_for_planner()
            cancelled_for_the_best(client)
            with busy_processes(4):
                for _ in range(asked):
                    request = least_attitude(client)
                    request.search.time_budget = float(10.0 ** rng.uniform(-2.0, 0.3))
                    answer = client.plan(request)
                    ends.append((answer.status.code, answer.solver.ended_by))
            # On a busy machine the recorder is behind.
            until = time.monotonic() + DEADLINE
            while not all_recorded(planner.bag, asked + 2):
                assert time.monotonic() < until, "not all answers are recorded"
            bag = planner.bag
    found = replays_of(bag)
    assert len(found) == asked + 2
    for plan_id, one in found.items():
        assert one.verdict is Verdict.IDENTICAL, (SEED, plan_id, ends, one.words)
    assert {code for code, _ in ends} <= {Status.SOLVED, Status.TIMED_OUT}
    assert (Status.SOLVED, EndedBy.DEADLINE) in ends
