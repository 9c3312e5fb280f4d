"""A plan is ready before it begins, and before it takes over from the one that runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from ff_planner_msgs.msg import PlanRequest
from rclpy.clock import ROSClock
from ros_processes import FRAME, Scene
from test_planning_service import answer, service
from test_takeover import state_on

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import NoPlanFound, Retry, Status
from ff_planner_ros.planning.motion.plan import REMAINDER, Plan
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.ros.messages.to_messages import state_message, time_message
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.deadline import Deadline
from ff_planner_ros.ros.requests.planning_service import PlanningService

NOW = 1_000 * NANOSECONDS
ALLOWANCE, HANDOVER = 0.2, 0.05  # [s]
WHEN = {"replanning__lead_time": ALLOWANCE, "replanning__handover": HANDOVER}


class Clock:
    """The node's, which a plan lets go on."""

    def __init__(self, answering: PlanningService) -> None:
        self.now_ns, self.searched_on = NOW, False
        answering._clock = self  # type: ignore[assignment]

    def now(self) -> Any:
        return SimpleNamespace(nanoseconds=self.now_ns)

    def after(self, seconds: float) -> None:
        self.now_ns = NOW + round(seconds * NANOSECONDS)


def solving(clock: Clock, plan: Plan, seconds: float, *, asks: bool) -> Callable[..., Plan]:
    """Return what takes so long for a plan, and asks then whether it is still wanted, or not."""

    def solve(_: Any, __: float, ___: float, check: Callable[[], None], *____: Any) -> Plan:
        clock.after(seconds)
        if asks:
            check()
        clock.searched_on = True
        return plan

    return solve


def request_at(problem: PlanningProblem, plan: Plan, continues: bool) -> PlanRequest:
    """A request with a state of now: where a plan is that has run for four seconds."""
    request = Scene(problem).complete_request()
    request.plan_only = True
    if continues:
        request.replan_active, request.duration = True, 0.0
        state = state_on(plan.trajectory, 4.0)
        request.start_state = [state_message(state, problem.robot.joint_names, NOW, FRAME)]
    return request


@pytest.mark.parametrize("asks", [True, False])
@pytest.mark.parametrize("continues", [True, False])
@pytest.mark.parametrize("part", [-1.0, 1.0])
def test_a_plan_that_comes_too_late_for_its_start_is_none(
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    monkeypatch: pytest.MonkeyPatch,
    part: float,
    continues: bool,
    asks: bool,
) -> None:
    """One that takes over has to be with the controller by then, and so is ready before."""
    overrides = WHEN | {"planning_lead_time": ALLOWANCE}
    with service(lemur_capture, monkeypatch, **overrides) as (answering, worker, _):
        clock = Clock(answering)
        latest = ALLOWANCE - (HANDOVER if continues else 0.0)
        worker.solve.side_effect = solving(clock, lemur_plan, latest + 1e-3 * part, asks=asks)
        begun_ns = NOW - 4 * NANOSECONDS
        if continues:
            answering._output.published = PublishedPlan("run.0", lemur_plan.trajectory, begun_ns)
        found = answer(answering, request_at(lemur_capture, lemur_plan, continues))
        waiting = dict(answering._publication._waiting)
    previous = "run.0" if continues else ""
    assert found.inputs.previous_plan_id == previous
    # The plan that is looked for may be what remains of the running one, which is never too late.
    assert clock.searched_on is (part < 0.0 or not asks or continues)
    if part > 0.0:
        assert found.status.code == Status.TOO_LATE, found.status
        assert found.status.message.startswith(
            "the handover from run.0, 0.200 s after the request (parameter replanning.lead_time, "
            "0.2 s), less 0.05 s for the controller (replanning.handover), was missed by 0.001 s: "
            if continues
            else "the start of the plan, 0.200 s after the request (parameter planning_lead_time, "
            "0.2 s), was missed by 0.001 s: "
        )
        assert " s to read the request, " in found.status.message
        assert " s to search" in found.status.message
        name = "replanning.lead_time" if continues else "planning_lead_time"
        assert f"; raise {name} first" in found.status.message
        assert waiting == {}
        return
    assert found.status.code == Status.SOLVED, found.status
    (written,) = found.plans
    assert nanoseconds(written.joint_trajectory.header.stamp) == NOW + 200_000_000
    assert waiting["run.1"].previous_plan_id == previous
    assert waiting["run.1"].start_ns == NOW + 200_000_000


def test_a_plan_whose_start_passes_while_its_answer_is_written_is_not_published(
    lemur_capture: PlanningProblem, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Thousands of points take a second."""
    with service(lemur_capture, monkeypatch, planning_lead_time=ALLOWANCE) as (
        answering,
        worker,
        _,
    ):
        clock, written = Clock(answering), answering._written
        worker.solve.side_effect = solving(clock, lemur_plan, ALLOWANCE / 2.0, asks=True)

        def slowly(outcome: Any, *arguments: Any) -> Any:
            clock.after(ALLOWANCE + 0.001)
            return written(outcome, *arguments)

        monkeypatch.setattr(answering, "_written", slowly)
        found = answer(answering, request_at(lemur_capture, lemur_plan, continues=False))
        waiting = dict(answering._publication._waiting)
    assert found.status.code == Status.TOO_LATE, found.status
    assert " s to write the plan" in found.status.message
    assert waiting == {}


def test_the_plan_that_runs_is_the_one_that_joints_follow_until_a_new_one_of_their_own(
    lemur_capture: PlanningProblem, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not asked to go on from it, a plan begins where it leaves the joints by then."""
    with service(lemur_capture, monkeypatch, planning_lead_time=1.0) as (answering, worker, _):
        clock = Clock(answering)
        worker.solve.side_effect = solving(clock, lemur_plan, 0.5, asks=True)
        begun_ns = NOW - 4 * NANOSECONDS
        answering._output.published = PublishedPlan("run.0", lemur_plan.trajectory, begun_ns)
        request = request_at(lemur_capture, lemur_plan, continues=True)
        request.replan_active, request.duration = False, 10.0
        found = answer(answering, request)
        (task, *_) = worker.solve.call_args.args
        waiting = dict(answering._publication._waiting)
    assert found.status.code == Status.SOLVED, found.status
    assert found.inputs.previous_plan_id == "run.0"
    assert waiting["run.1"].previous_plan_id == "run.0"
    assert (task.running_goal, task.ahead) == (None, pytest.approx(1.0))
    # No more of it than until the new plan starts
    assert -0.21 < task.running.time[0] <= 0.0 < 1.0 < task.running.time[-1] < 1.21


@pytest.mark.parametrize("late", [0.001, 0.9, 1.1])
def test_what_remains_of_the_running_plan_is_an_answer_after_its_handover_too(
    lemur_capture: PlanningProblem, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch, late: float
) -> None:
    """It is what the joints do anyway; any other plan, or one that takes over nothing, is late."""
    remainder = replace(lemur_plan, family=REMAINDER)
    overrides = WHEN | {"planning_lead_time": ALLOWANCE}
    for continues, plan in ((True, remainder), (True, lemur_plan), (False, remainder)):
        with service(lemur_capture, monkeypatch, **overrides) as (answering, worker, _):
            clock = Clock(answering)
            latest = ALLOWANCE - (HANDOVER if continues else 0.0)
            worker.solve.side_effect = solving(clock, plan, latest + late, asks=True)
            begun_ns = NOW - 4 * NANOSECONDS
            answering._output.published = PublishedPlan("run.0", lemur_plan.trajectory, begun_ns)
            found = answer(answering, request_at(lemur_capture, lemur_plan, continues))
        is_answer = continues and plan is remainder and late < 1.0
        assert found.status.code == (Status.SOLVED if is_answer else Status.TOO_LATE)
        if is_answer:
            (written,) = found.plans
            assert written.family == REMAINDER
            assert nanoseconds(written.joint_trajectory.header.stamp) == NOW + 200_000_000
        elif late < 1.0 or not continues:
            assert found.status.retry == Retry.LATER
            assert f"was missed by {late:.3f} s" in found.status.message


@pytest.mark.law("NODE-13")
@pytest.mark.parametrize("ended", ["with a plan that is late", "without a plan"])
@pytest.mark.parametrize("continues", [True, False])
def test_what_remains_of_the_running_plan_is_asked_for_where_nothing_else_is_there_in_time(
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    monkeypatch: pytest.MonkeyPatch,
    continues: bool,
    ended: str,
) -> None:
    overrides = WHEN | {"planning_lead_time": ALLOWANCE}
    remainder = replace(lemur_plan, family=REMAINDER, effort=1)
    with service(lemur_capture, monkeypatch, **overrides) as (answering, worker, _):
        clock, tasks = Clock(answering), []

        def solve(task: PlanningTask, *_: Any) -> Plan:
            tasks.append(task)
            clock.after(ALLOWANCE + 0.1)
            if task.effort == 1:  # it ends where the search would begin
                return remainder
            if ended == "without a plan":
                raise NoPlanFound(Status.TIMED_OUT, "the time budget is used up", effort=7)
            return lemur_plan

        worker.solve.side_effect = solve
        begun_ns = NOW - 4 * NANOSECONDS
        answering._output.published = PublishedPlan("run.0", lemur_plan.trajectory, begun_ns)
        found = answer(answering, request_at(lemur_capture, lemur_plan, continues))
    if not continues:
        assert (len(tasks), found.status.code) == (1, Status.TOO_LATE)
        return
    assert [task.effort for task in tasks] == [0, 1]
    assert found.status.code == Status.SOLVED, found.status
    assert (found.plans[0].family, found.plans[0].effort) == (REMAINDER, 1)
    assert found.task_digest == tasks[1].digest, "it is replayed from the answer"


def test_what_was_asked_for_a_time_of_its_own_is_told_to_ask_for_a_later_one(
    lemur_capture: PlanningProblem, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service(lemur_capture, monkeypatch) as (answering, worker, _):
        clock = Clock(answering)
        worker.solve.side_effect = solving(clock, lemur_plan, 3.5, asks=True)
        request = request_at(lemur_capture, lemur_plan, continues=False)
        request.start_time = time_message(NOW + 3 * NANOSECONDS)
        found = answer(answering, request)
    assert found.status.code == Status.TOO_LATE
    assert found.status.message.startswith(
        "the start of the plan, at the start_time asked for, 3.000 s after the request, was missed "
        "by 0.500 s: "
    )
    assert found.status.message.endswith("; ask for a later start_time first")
    assert found.status.retry == Retry.CHANGED


@pytest.mark.parametrize("continues", [True, False])
def test_the_search_knows_by_when_its_best_plan_has_to_be_there(
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    monkeypatch: pytest.MonkeyPatch,
    continues: bool,
) -> None:
    overrides = WHEN | {"planning_lead_time": ALLOWANCE}
    out_of_time = NoPlanFound(Status.TIMED_OUT, "the time budget is used up", effort=7)
    with service(lemur_capture, monkeypatch, **overrides) as (answering, worker, _):
        Clock(answering)
        worker.solve.side_effect = out_of_time
        begun_ns = NOW - 4 * NANOSECONDS
        answering._output.published = PublishedPlan("run.0", lemur_plan.trajectory, begun_ns)
        found = answer(answering, request_at(lemur_capture, lemur_plan, continues))
        _, budget, taken_up, *_ = worker.solve.call_args_list[0].args
    latest = ALLOWANCE - (HANDOVER if continues else 0.0)
    assert 0.0 < budget.seconds <= 0.9 * latest + (time.monotonic() - taken_up)
    # A running plan's remainder is one, and the rest of the time is for its way.
    with_plan = budget.with_plan - (time.monotonic() - taken_up)
    assert (with_plan <= 0.5 * latest) is continues
    # It was not its own budget that ended it: without a clock it is planned to its end.
    assert found.status.code == Status.TOO_LATE
    assert "would be missed" in found.status.message
    assert "the time budget is used up" in found.status.message


def test_where_time_is_simulated_the_start_is_no_time_of_the_wall_clock() -> None:
    deadline = Deadline(NANOSECONDS, "the start", "ask later")  # a second from its zero
    simulated = ROSClock()
    simulated._set_ros_time_is_active(True)
    assert deadline.limited(Budget(50.0), simulated, time.monotonic()) == Budget(50.0)
