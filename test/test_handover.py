"""A plan is ready before it begins, and before it takes over from the one that runs."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from ff_planner_msgs.msg import PlanRequest
from ros_processes import FRAME, Scene
from test_planning_service import answer, service
from test_takeover import state_on

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.messages.to_messages import state_message
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.planning_service import PlanningService

NOW = 1_000 * NANOSECONDS
ALLOWANCE, HANDOVER = 0.2, 0.05  # [s]
WHEN = {"replanning__allowance": ALLOWANCE, "replanning__handover": HANDOVER}


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
    assert clock.searched_on is (part < 0.0 or not asks)
    if part > 0.0:
        assert found.status.code == Status.TOO_LATE, found.status
        assert waiting == {}
        return
    assert found.status.code == Status.SOLVED, found.status
    (written,) = found.plans
    assert nanoseconds(written.joint_trajectory.header.stamp) == NOW + 200_000_000
    assert waiting["run.1"].previous_plan_id == previous
    assert waiting["run.1"].start_ns == NOW + 200_000_000
    assert waiting["run.1"].token == found.publish_token != ""


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
    assert task.running.time[0] == pytest.approx(-4.0)
