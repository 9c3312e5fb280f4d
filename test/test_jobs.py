"""Requests, one at a time: who is refused, who makes way, who is given up."""

from __future__ import annotations

import threading
from unittest.mock import Mock

import pytest
from ff_planner_msgs.msg import PlanRequest
from ros_processes import DEADLINE

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.messages.exchange_words import Interface
from ff_planner_ros.ros.requests.jobs import Job, Jobs


def a_job(plan_id: str, number: int) -> Job:
    return Job(plan_id, number, PlanRequest(), Interface.SERVICE, "executive")


def opened(*, preempt: bool = False) -> tuple[Jobs, Mock]:
    interrupt = Mock()
    jobs = Jobs(interrupt, preempt=preempt)
    jobs.open()
    return jobs, interrupt


def status_of(jobs: Jobs, job: Job) -> Status:
    with pytest.raises(FfPlannerError) as refusal, jobs.taken_up(job):
        pass
    return refusal.value.status


def test_before_it_is_opened_and_after_it_is_closed_nobody_is_taken_up() -> None:
    jobs = Jobs(Mock(), preempt=False)
    assert status_of(jobs, a_job("a", 1)) is Status.NOT_ACTIVE
    jobs.open()
    with jobs.taken_up(a_job("b", 2)):
        pass
    jobs.close(Status.SHUT_DOWN, "over")
    assert status_of(jobs, a_job("c", 3)) is Status.SHUT_DOWN


def test_a_second_job_is_refused_while_the_first_is_planned_and_welcome_after() -> None:
    jobs, interrupt = opened()
    with jobs.taken_up(a_job("first", 1)):
        assert status_of(jobs, a_job("second", 2)) is Status.BUSY
    with jobs.taken_up(a_job("third", 3)):
        pass
    interrupt.assert_not_called()


def test_a_job_that_is_admitted_is_the_only_one_until_it_is_taken_up() -> None:
    jobs, interrupt = opened()
    first, second = a_job("first", 1), a_job("second", 2)
    for job in (first, second):
        jobs.admit(job)
    assert status_of(jobs, a_job("third", 3)) is Status.BUSY
    with jobs.taken_up(first):
        assert status_of(jobs, a_job("fourth", 4)) is Status.BUSY
    assert status_of(jobs, second) is Status.BUSY
    with jobs.taken_up(a_job("sixth", 6)):
        pass
    interrupt.assert_not_called()


def test_an_admitted_job_that_is_given_up_before_it_is_taken_up_leaves_room() -> None:
    jobs, _ = opened()
    jobs.admit(third := a_job("third", 3))
    jobs.close(Status.NOT_ACTIVE, "closed")
    assert status_of(jobs, third) is Status.NOT_ACTIVE
    jobs.admit(fourth := a_job("fourth", 4))
    jobs.open()
    assert status_of(jobs, fourth) is Status.NOT_ACTIVE
    with jobs.taken_up(a_job("fifth", 5)):
        pass


def test_a_preempting_job_waits_until_the_other_has_made_way() -> None:
    jobs, interrupt = opened(preempt=True)
    first, order = a_job("first", 1), []

    def second() -> None:
        with jobs.taken_up(a_job("second", 2)):
            order.append("second")

    thread = threading.Thread(target=second)
    given_up = threading.Event()
    interrupt.side_effect = given_up.set
    with jobs.taken_up(first):
        thread.start()
        assert given_up.wait(DEADLINE)
        order.append("first")
    thread.join(DEADLINE)
    assert order == ["first", "second"]
    assert first.cause is not None
    assert first.cause.status is Status.PREEMPTED
    assert "second" in str(first.cause)


def test_a_job_that_was_given_up_before_its_turn_is_not_taken_up() -> None:
    jobs, interrupt = opened()
    job = a_job("early", 1)
    assert jobs.give_up(job, FfPlannerError(Status.CANCELLED, "changed my mind"))
    assert status_of(jobs, job) is Status.CANCELLED
    interrupt.assert_not_called()


def test_the_first_cause_counts() -> None:
    job = a_job("a", 1)
    assert job.give_up(FfPlannerError(Status.CANCELLED, "first"))
    assert job.give_up(FfPlannerError(Status.PREEMPTED, "second"))
    with pytest.raises(FfPlannerError, match="first"):
        job.check()
    with pytest.raises(FfPlannerError, match="first"):
        job.seal()


def test_a_sealed_job_cannot_be_given_up() -> None:
    jobs, interrupt = opened()
    job = a_job("a", 1)
    with jobs.taken_up(job):
        job.seal()
        assert not jobs.give_up(job, FfPlannerError(Status.CANCELLED, "too late"))
    job.check()
    interrupt.assert_not_called()


def test_giving_up_all_spares_those_that_come_after() -> None:
    jobs, _ = opened()
    job = a_job("a", 1)
    with jobs.taken_up(job):
        jobs.give_up_all(Status.CLOCK_JUMPED, "back")
    assert job.cause is not None
    assert job.cause.status is Status.CLOCK_JUMPED
    with jobs.taken_up(a_job("b", 2)):
        pass


def test_a_job_that_came_before_the_one_that_is_planned_does_not_take_its_place() -> None:
    """Threads may bring two requests in the wrong order."""
    jobs, _ = opened(preempt=True)
    newest = a_job("newest", 2)
    with jobs.taken_up(newest):
        assert status_of(jobs, a_job("second", 1)) is Status.PREEMPTED
        assert newest.cause is None
