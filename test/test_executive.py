"""The mission executive, against a planner that answers as told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from itertools import chain, repeat

import pytest
import rclpy
from ff_planner_msgs.msg import ChaserState, PlanStatus
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.executors import SingleThreadedExecutor
from ros_processes import DEADLINE, private_domain

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.ros.background import spin_in_background
from ff_planner_ros.ros.executive import MissionExecutive


@contextmanager
def _executive(
    *answers: Status, patience: float = DEADLINE, check: Callable[[], None] = lambda: None
) -> Iterator[tuple[MissionExecutive, list[Status]]]:
    """Start an executive and a planner with these answers, the last one for ever."""
    given: list[Status] = []
    coming = chain(answers, repeat(answers[-1])) if answers else iter(())

    def answer(
        _: PlanTrajectory.Request, response: PlanTrajectory.Response
    ) -> PlanTrajectory.Response:
        given.append(next(coming))
        response.status = PlanStatus(code=given[-1], message=f"because of {given[-1].name}")
        return response

    with private_domain(), closing(MissionExecutive(check, patience)) as executive:
        node = rclpy.create_node("planner")
        states = node.create_publisher(ChaserState, "chaser_state", 10)
        node.create_timer(0.01, lambda: states.publish(ChaserState()))
        if answers:
            node.create_service(PlanTrajectory, "plan_trajectory", answer)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        stop = spin_in_background(executor, node.get_logger())
        try:
            yield executive, given
        finally:
            stop()


@pytest.mark.parametrize("refusal", [Status.NO_STATE, Status.NO_OBSTACLES, Status.STATE_TOO_OLD])
def test_it_asks_again_while_the_system_starts(refusal: Status) -> None:
    with _executive(refusal, refusal, Status.SOLVED) as (executive, given):
        assert executive.plan(PlanTrajectory.Request()).status.code == Status.SOLVED
        assert given == [refusal, refusal, Status.SOLVED]


@pytest.mark.parametrize("refusal", [Status.COLLISION, Status.WRONG_FRAME, Status.INTERNAL_ERROR])
def test_a_refusal_that_will_not_pass_is_raised_at_once(refusal: Status) -> None:
    with _executive(refusal) as (executive, given):
        with pytest.raises(FfPlannerError, match=f"because of {refusal.name}") as raised:
            executive.plan(PlanTrajectory.Request())
        assert raised.value.status is refusal
        assert given == [refusal]


def test_its_patience_ends_when_the_planner_never_hears_of_the_chaser() -> None:
    with (
        _executive(Status.NO_STATE, patience=1.0) as (executive, _),
        pytest.raises(FfPlannerError, match="because of NO_STATE"),
    ):
        executive.plan(PlanTrajectory.Request())


def test_its_patience_ends_when_there_is_no_planner() -> None:
    with (
        _executive(patience=0.0) as (executive, _),
        pytest.raises(FfPlannerError, match="the service plan_trajectory did not come"),
    ):
        executive.plan(PlanTrajectory.Request())


def test_it_stops_waiting_when_its_check_fails() -> None:
    def check() -> None:
        raise FfPlannerError(Status.INTERNAL_ERROR, "the planner has ended")

    with (
        _executive(check=check) as (executive, _),
        pytest.raises(FfPlannerError, match="the planner has ended"),
    ):
        executive.plan(PlanTrajectory.Request())
