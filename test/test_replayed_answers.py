"""What a replay says of an answer, and which plan the joints followed then."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from answers import answer_of
from ff_planner_msgs.msg import PlanAnswer, PlanRequest

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import BagError, FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.ros.messages.to_messages import answer_of_error, time_message
from ff_planner_ros.runs import replay as replay_module
from ff_planner_ros.runs.installed import PlanExchange
from ff_planner_ros.runs.recorded_run import RecordedRequest, _published
from ff_planner_ros.runs.replay import ALL_SAME, DIFFERS, Verdict, print_replay, replay

START = 1_000 * NANOSECONDS


def answered(plan: Plan, **changes: float) -> PlanAnswer:
    """An answer with a plan whose last sample of some quantities is off."""
    motion = plan.trajectory
    for name, off in changes.items():
        samples = np.array(getattr(motion, name))
        samples[-1, -1] += off
        motion = replace(motion, **{name: samples})
    return answer_of(replace(plan, trajectory=motion), start_ns=START)


def refused(status: Status) -> PlanAnswer:
    return answer_of_error(FfPlannerError(status, "because"), "run.1", 0.1)


def recorded(response: PlanAnswer | None) -> RecordedRequest:
    inputs: Any = SimpleNamespace(robot=None)
    return RecordedRequest("run.1", "service", PlanRequest(), response, inputs, "", ())


@pytest.fixture
def again(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets what the planner answers now."""

    def answers(answer: PlanAnswer | BagError) -> None:
        def answer_again(_: RecordedRequest, __: int) -> tuple[PlanAnswer, float]:
            if isinstance(answer, BagError):
                raise answer
            return answer, 0.25

        monkeypatch.setattr(replay_module, "answer_again", answer_again)

    return answers


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, Verdict.IDENTICAL),
        ({"joint_positions": 1e-9}, Verdict.WITHIN_TOLERANCE),
        ({"joint_positions": -1e-9, "ee_positions": 1e-9}, Verdict.WITHIN_TOLERANCE),
        ({"joint_positions": 1e-3}, Verdict.DIFFERENT),
        ({"joint_positions": -1e-3}, Verdict.DIFFERENT),
        ({"joint_positions": 1e-9, "ee_positions": -1e-3}, Verdict.DIFFERENT),
        ({"chaser_positions": -1e-3, "joint_torques": 1e-9}, Verdict.DIFFERENT),
    ],
)
def test_one_difference_that_counts_makes_an_answer_another_one(
    lemur_plan: Plan, again: Any, changes: dict[str, float], verdict: Verdict
) -> None:
    again(answered(lemur_plan, **changes))
    found = replay(recorded(answered(lemur_plan)))
    assert found.verdict is verdict
    assert {one.quantity for one in found.differences} == changes.keys()


def test_a_plan_and_a_refusal_are_different_and_so_are_two_refusals(
    lemur_plan: Plan, again: Any
) -> None:
    plan = answered(lemur_plan)
    for then, now in (
        (plan, refused(Status.COLLISION)),
        (refused(Status.COLLISION), plan),
        (refused(Status.COLLISION), refused(Status.SINGULAR)),
        (None, plan),
    ):
        again(now)
        assert replay(recorded(then)).verdict is Verdict.DIFFERENT
    again(refused(Status.COLLISION))
    assert replay(recorded(refused(Status.COLLISION))).verdict is Verdict.IDENTICAL


@pytest.mark.parametrize(
    ("status", "verdict"),
    [
        *((status, Verdict.WITHOUT_CLOCK) for status in (Status.TOO_LATE, Status.TIMED_OUT)),
        *(
            (status, Verdict.NOT_REPLAYABLE)
            for status in (Status.BUSY, Status.CANCELLED, Status.PREEMPTED, Status.NOT_ACTIVE)
        ),
    ],
)
def test_what_the_clock_or_the_world_answered_is_no_difference(
    lemur_plan: Plan, again: Any, status: Status, verdict: Verdict
) -> None:
    again(answered(lemur_plan))
    assert replay(recorded(refused(status))).verdict is verdict
    again(BagError("the state is not in the bag"))
    if verdict is Verdict.WITHOUT_CLOCK:
        assert replay(recorded(refused(status))).verdict is Verdict.NOT_REBUILT


@pytest.mark.parametrize(
    ("off", "missing", "code"),
    [(0.0, False, ALL_SAME), (1e-9, False, ALL_SAME), (1e-3, False, DIFFERS), (0.0, True, DIFFERS)],
)
def test_the_exit_code_tells_whether_every_answer_came_again(
    lemur_plan: Plan,
    again: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    off: float,
    missing: bool,
    code: int,
) -> None:
    """One request among others that are the same."""
    same, other = recorded(answered(lemur_plan)), recorded(answered(lemur_plan, ee_positions=off))
    again(BagError("gone") if missing else answered(lemur_plan))
    run = SimpleNamespace(requests=(same, other, same), provenance={}, notes=())
    monkeypatch.setattr(replay_module, "open_bag", lambda _: nullcontext())
    monkeypatch.setattr(replay_module, "recorded_run", lambda _: run)
    assert print_replay(Path("a_bag")) == code
    assert ("DIFFERENT" in capsys.readouterr().out) == (off == 1e-3)


def exchange(plan: Plan | None, plan_id: str, following: str = "") -> PlanExchange:
    """A request and its answer."""
    response = refused(Status.COLLISION) if plan is None else answer_of(plan, start_ns=START)
    response.plan_id, response.inputs.previous_plan_id = plan_id, following
    response.inputs.received_stamp = time_message(START)
    return PlanExchange("service", "/plan_trajectory", 0, 0, PlanRequest(), response)


def test_the_plan_that_was_followed_is_the_one_that_the_answer_names(lemur_plan: Plan) -> None:
    plan = replace(lemur_plan, duration=7.5)
    before = [
        exchange(plan, "run.1"),
        exchange(plan, "run.2", "run.1"),
        exchange(None, "run.3"),
        exchange(plan, "run.4"),
    ]
    found = _published(before, exchange(plan, "run.5", "run.2"))
    assert found is not None
    assert (found.plan_id, found.start_ns, found.seconds_to_goal) == ("run.2", START, 7.5)
    assert found.before is not None
    assert found.before.plan_id == "run.1"
    alone = _published(before, exchange(plan, "run.5", "run.4"))
    assert alone is not None
    assert (alone.plan_id, alone.before) == ("run.4", None)
    assert _published(before, exchange(plan, "run.5")) is None
    with pytest.raises(BagError, match=r"plan run\.3, which the joints followed"):
        _published(before, exchange(plan, "run.5", "run.3"))
