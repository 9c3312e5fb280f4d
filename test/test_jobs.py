"""Requests, one at a time: who is refused, who makes way, who is given up."""

from __future__ import annotations

import threading
from unittest.mock import Mock

import pytest
from ros_processes import DEADLINE

from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.ros.requests.jobs import Job, Jobs


def opened() -> tuple[Jobs, Mock]:
    interrupt = Mock()
    jobs = Jobs(interrupt)
    jobs.open()
    return jobs, interrupt


def status_of(jobs: Jobs, job: Job, *, preempt: bool = False) -> Status:
    with pytest.raises(FfPlannerError) as refusal, jobs.taken_up(job, preempt=preempt):
        pass
    return refusal.value.status


def test_before_it_is_opened_and_after_it_is_closed_nobody_is_taken_up() -> None:
    jobs = Jobs(Mock())
    assert status_of(jobs, Job("a", 1)) is Status.NOT_ACTIVE
    jobs.open()
    with jobs.taken_up(Job("b", 2), preempt=False):
        pass
    jobs.close(Status.SHUT_DOWN, "over")
    assert status_of(jobs, Job("c", 3)) is Status.SHUT_DOWN


def test_a_second_job_is_refused_while_the_first_is_planned_and_welcome_after() -> None:
    jobs, interrupt = opened()
    with jobs.taken_up(Job("first", 1), preempt=False):
        assert status_of(jobs, Job("second", 2)) is Status.BUSY
    with jobs.taken_up(Job("third", 3), preempt=False):
        pass
    interrupt.assert_not_called()


def test_a_job_that_is_admitted_is_the_only_one_until_it_is_taken_up() -> None:
    jobs, interrupt = opened()
    first, second = Job("first", 1), Job("second", 2)
    for job in (first, second):
        jobs.admit(job, preempt=False)
    assert status_of(jobs, Job("third", 3)) is Status.BUSY
    with jobs.taken_up(first, preempt=False):
        assert status_of(jobs, Job("fourth", 4)) is Status.BUSY
    assert status_of(jobs, second) is Status.BUSY
    with jobs.taken_up(Job("sixth", 6), preempt=False):
        pass
    interrupt.assert_not_called()


def test_an_admitted_job_that_is_given_up_before_it_is_taken_up_leaves_room() -> None:
    jobs, _ = opened()
    jobs.admit(first := Job("first", 1), preempt=False)
    with jobs.taken_up(Job("second", 2), preempt=True):
        assert status_of(jobs, first) is Status.PREEMPTED
    jobs.admit(third := Job("third", 3), preempt=False)
    jobs.close(Status.NOT_ACTIVE, "closed")
    assert status_of(jobs, third) is Status.NOT_ACTIVE
    jobs.admit(fourth := Job("fourth", 4), preempt=True)
    jobs.open()
    assert status_of(jobs, fourth, preempt=True) is Status.NOT_ACTIVE
    with jobs.taken_up(Job("fifth", 5), preempt=False):
        pass


def test_a_preempting_job_waits_until_the_other_has_made_way() -> None:
    jobs, interrupt = opened()
    first, order = Job("first", 1), []

    def second() -> None:
        with jobs.taken_up(Job("second", 2), preempt=True):
            order.append("second")

    thread = threading.Thread(target=second)
    given_up = threading.Event()
    interrupt.side_effect = given_up.set
    with jobs.taken_up(first, preempt=True):
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
    job = Job("early", 1)
    assert jobs.give_up(job, FfPlannerError(Status.CANCELLED, "changed my mind"))
    assert status_of(jobs, job) is Status.CANCELLED
    interrupt.assert_not_called()


def test_the_first_cause_counts() -> None:
    job = Job("a", 1)
    assert job.give_up(FfPlannerError(Status.CANCELLED, "first"))
    assert job.give_up(FfPlannerError(Status.PREEMPTED, "second"))
    with pytest.raises(FfPlannerError, match="first"):
        job.check()
    with pytest.raises(FfPlannerError, match="first"):
        job.seal()


def test_a_sealed_job_cannot_be_given_up() -> None:
    jobs, interrupt = opened()
    job = Job("a", 1)
    with jobs.taken_up(job, preempt=False):
        job.seal()
        assert not jobs.give_up(job, FfPlannerError(Status.CANCELLED, "too late"))
    job.check()
    interrupt.assert_not_called()


def test_giving_up_all_spares_those_that_come_after() -> None:
    jobs, _ = opened()
    job = Job("a", 1)
    with jobs.taken_up(job, preempt=False):
        jobs.give_up_all(Status.CLOCK_JUMPED, "back")
    assert job.cause is not None
    assert job.cause.status is Status.CLOCK_JUMPED
    with jobs.taken_up(Job("b", 2), preempt=False):
        pass


def test_a_job_that_came_before_the_one_that_is_planned_does_not_take_its_place() -> None:
    """Threads may bring two requests in the wrong order."""
    jobs = Jobs(Mock())
    jobs.open()
    newest = Job("newest", 2)
    with jobs.taken_up(newest, preempt=True):
        assert status_of(jobs, Job("second", 1), preempt=True) is Status.PREEMPTED
        assert newest.cause is None
