"""The action beside the service: same answers, with feedback and cancellation, one at a time."""

from __future__ import annotations

import math
import random
import signal
import time
from collections.abc import Callable, Iterator

import pytest
from action_msgs.msg import GoalStatus
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from managed_node import Manager
from quick_capture import resting_capture
from ros_processes import (
    DEADLINE,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
)

from ff_planner_ros.errors import Status

SEED = 20260101
PATIENCE = 60.0  # [s] for a plan; a busy machine takes its time


@pytest.fixture(scope="module")
def client(planner: PlannerProcess) -> Iterator[Client]:  # noqa: ARG001 (it must run)
    with connected_client() as client:
        client.wait_for_planner()
        yield client


@pytest.fixture
def scene() -> Scene:
    return Scene(resting_capture())


def long(scene: Scene) -> PlanRequest:
    """A request whose plan takes seconds: it has thousands of points."""
    request = scene.complete_request()
    request.search.points = 5000
    return request


def set_parameter(client: Client, name: str, value: object) -> None:
    Manager(client).configure_with(name, value)
    client.wait_for_planner()


def test_goal_and_result_have_the_fields_of_request_and_response() -> None:
    of_action, of_service = PlanTrajectoryAction, PlanTrajectory
    for ours, theirs in (
        (of_action.Goal, of_service.Request),
        (of_action.Result, of_service.Response),
    ):
        assert ours.get_fields_and_field_types() == theirs.get_fields_and_field_types()


def test_a_goal_is_answered_like_a_request_with_feedback_on_the_way(
    client: Client, scene: Scene
) -> None:
    request = scene.complete_request()
    request.search.points = 1000  # fewer end before there is something to tell
    request.start_state[0].header.stamp = client.node.get_clock().now().to_msg()
    request.start_time.sec = request.start_state[0].header.stamp.sec + round(PATIENCE)
    goal = client.send_goal(request)
    status, result = goal.result()
    assert (status, result.status.code) == (GoalStatus.STATUS_SUCCEEDED, Status.SOLVED)
    (planned,), (again,) = result.plans, client.plan(request).plans
    assert again.joint_trajectory == planned.joint_trajectory
    assert goal.feedback
    assert {f.phase for f in goal.feedback} <= {"searching", "refining", "checking"}
    assert all(f.effort >= 1 for f in goal.feedback)
    assert all(math.isnan(f.best_objective) is not f.found for f in goal.feedback)
    found = [f.best_objective for f in goal.feedback if f.found]
    assert found
    assert found == sorted(found, reverse=True)
    elapsed = [f.elapsed for f in goal.feedback]
    assert elapsed == sorted(elapsed)


def test_a_goal_that_is_refused_is_aborted_with_its_code_and_words(
    client: Client, scene: Scene
) -> None:
    request = scene.complete_request()
    request.duration = -1.0
    status, result = client.send_goal(request).result()
    assert (status, result.status.code) == (GoalStatus.STATUS_ABORTED, Status.OUT_OF_RANGE)
    assert result.status.message.startswith("duration is -1")


@pytest.mark.law("NODE-10")
def test_cancelled_at_random_moments_a_goal_ends_cancelled_or_was_solved_before(
    client: Client, scene: Scene, times: Callable[[int, int], int]
) -> None:
    """Moments are told by the search's own progress, which no clock has a say in."""
    moments, statuses = random.Random(SEED), set()
    for _ in range(times(50, 200)):
        goal = client.send_goal(scene.complete_request())
        for _ in range(moments.randrange(4)):
            goal.progress.wait(0.1)
            goal.progress.clear()
        accepted = goal.cancel()
        status, result = goal.result()
        if accepted:
            assert (status, result.status.code) == (GoalStatus.STATUS_CANCELED, Status.CANCELLED)
            assert not result.plans
        else:
            assert (status, result.status.code) == (GoalStatus.STATUS_SUCCEEDED, Status.SOLVED)
        statuses.add(status)
    assert GoalStatus.STATUS_CANCELED in statuses
    assert client.plan(scene.complete_request()).status.code == Status.SOLVED


def test_a_search_for_the_best_moment_is_cancelled_like_any_other(
    client: Client, scene: Scene
) -> None:
    request = long(scene)
    request.duration, request.duration_max = 0.8 * request.duration, 2.0 * request.duration
    request.objective.duration = 0.1
    goal = client.send_goal(request)
    assert goal.progress.wait(DEADLINE)
    assert goal.cancel()
    status, result = goal.result()
    assert (status, result.status.code) == (GoalStatus.STATUS_CANCELED, Status.CANCELLED)
    assert not result.plans
    assert client.plan(scene.complete_request()).status.code == Status.SOLVED


def test_a_second_client_is_told_that_the_planner_is_busy(client: Client, scene: Scene) -> None:
    goal = client.send_goal(long(scene))
    assert goal.progress.wait(DEADLINE)
    refusal = client.plan(scene.complete_request())
    assert refusal.status.code == Status.BUSY
    assert "when_busy" in refusal.status.message
    status, refused = client.send_goal(scene.complete_request()).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert refused.status == refusal.status
    assert goal.cancel()
    assert goal.result()[1].status.code == Status.CANCELLED


def test_a_newer_request_takes_the_older_ones_place_where_the_parameter_says_so(
    client: Client, scene: Scene
) -> None:
    set_parameter(client, "when_busy", "preempt")
    goals = [client.send_goal(long(scene))]
    assert goals[0].progress.wait(DEADLINE)
    goals += [client.send_goal(long(scene)) for _ in range(3)]
    # Which of those in quick succession is the newest is for the planner to say.
    give_up = time.monotonic() + DEADLINE
    while not any(goal.progress.wait(0.1) for goal in goals[1:]):
        assert time.monotonic() < give_up
    newest = client.plan(scene.complete_request())
    assert newest.status.code == Status.SOLVED
    for goal in goals:
        status, result = goal.result()
        assert (status, result.status.code) == (GoalStatus.STATUS_ABORTED, Status.PREEMPTED)
        assert "took its place" in result.status.message
    set_parameter(client, "when_busy", "reject")


def test_a_plan_that_is_ready_too_late_is_refused_as_such(client: Client, scene: Scene) -> None:
    set_parameter(client, "planning_lead_time", 0.01)
    status, result = client.send_goal(scene.complete_request()).result()
    assert (status, result.status.code) == (GoalStatus.STATUS_ABORTED, Status.TOO_LATE)
    assert "planning_lead_time" in result.status.message
    set_parameter(client, "planning_lead_time", PATIENCE)


def test_a_request_is_answered_when_its_start_passes_whatever_its_solver_does(
    planner: PlannerProcess, client: Client, scene: Scene
) -> None:
    """A process that is stopped stands for one in the midst of a long iteration."""
    allowance = 3.0
    set_parameter(client, "planning_lead_time", allowance)
    goal = client.send_goal(long(scene))
    if goal.progress.wait(allowance):
        planner.send_to_solvers(signal.SIGSTOP)
    status, result = goal.result()
    planner.send_to_solvers(signal.SIGCONT)
    assert (status, result.status.code) == (GoalStatus.STATUS_ABORTED, Status.TOO_LATE)
    set_parameter(client, "planning_lead_time", PATIENCE)
    assert client.plan(scene.complete_request()).status.code == Status.SOLVED


@pytest.mark.law("NODE-12")
def test_a_solver_that_is_killed_in_a_plan_is_the_goals_result(
    planner: PlannerProcess, client: Client, scene: Scene
) -> None:
    goal = client.send_goal(long(scene))
    assert goal.progress.wait(DEADLINE)
    planner.send_to_solvers(signal.SIGKILL)
    status, result = goal.result()
    assert (status, result.status.code) == (GoalStatus.STATUS_ABORTED, Status.SOLVER_DIED)
    assert client.plan(scene.complete_request()).status.code == Status.SOLVED


def test_of_goals_at_once_all_are_accepted_one_is_planned_and_the_others_are_busy(
    planner: PlannerProcess, client: Client, scene: Scene
) -> None:
    told_before = planner.log.count("BUSY")
    goals = [client.send_goal_at_once(long(scene)) for _ in range(20)]
    assert all(goal.is_accepted for goal in goals)
    give_up = time.monotonic() + DEADLINE
    while not any(goal.progress.wait(0.01) for goal in goals):
        assert time.monotonic() < give_up
    (planned,) = (goal for goal in goals if goal.progress.is_set())
    assert planned.cancel()
    assert planned.result()[1].status.code == Status.CANCELLED
    refused = [goal.result() for goal in goals if goal is not planned]
    assert {status for status, _ in refused} == {GoalStatus.STATUS_ABORTED}
    assert {answer.status.code for _, answer in refused} == {Status.BUSY}
    assert planner.log.count("BUSY") - told_before == len(refused)
    assert client.plan(scene.complete_request()).status.code == Status.SOLVED
