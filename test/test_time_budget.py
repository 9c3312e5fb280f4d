"""The time budget, on a clock that the test winds."""

from __future__ import annotations

from unittest.mock import Mock

import pytest

from ff_planner_ros import time_budget as module
from ff_planner_ros.errors import OutOfTime, Status
from ff_planner_ros.planning.check.check import out_of_time
from ff_planner_ros.planning.motion.watch import CHECKING, Budget
from ff_planner_ros.time_budget import TimeBudget


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that shows its only entry."""
    shown = [1000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: shown[0])
    return shown


def test_a_budget_lasts_until_it_is_used_up(clock: list[float]) -> None:
    """A step takes no longer than the last ones, and the answer another check."""
    watch = TimeBudget(Budget(2.5))
    watch.require_time(CHECKING)
    for clock[0] in (1000.125, 1001.125, 1001.25):
        watch.require_time()
    clock[0] = 1001.375  # a step of 1 s and a check of 0.125 s are left
    watch.require_time()
    clock[0] = 1001.5
    with pytest.raises(OutOfTime, match=r"the time budget of 2\.5 s is used up") as end:
        watch.require_time()
    assert end.value.status is Status.TIMED_OUT


def test_the_first_check_is_foretold_from_the_steps_before_it(clock: list[float]) -> None:
    watch = TimeBudget(Budget(2.75))
    for clock[0] in (1000.0, 1000.25, 1000.5):
        watch.require_time()
    clock[0] = 1000.875  # eight steps of 0.25 s
    with pytest.raises(OutOfTime):
        watch.require_time(CHECKING)


def test_a_step_that_had_to_wait_foretells_no_check(clock: list[float]) -> None:
    watch = TimeBudget(Budget(10.0))
    # The first step loads what the others find loaded; a later one waits for the processor.
    for clock[0] in (1000.0, 1001.5, 1001.625, 1001.75, 1003.25, 1003.375):
        watch.require_time()
    clock[0] = 1007.0  # eight steps of 0.125 s, and one of 3.625 s
    with pytest.raises(OutOfTime, match=r"used up$") as end:
        watch.require_time()
    assert "3.00 s too short for the next step and its check" in str(end.value.used_for)


def test_what_was_just_checked_needs_no_other_check(clock: list[float]) -> None:
    watch = TimeBudget(Budget(2.5))
    watch.require_time(CHECKING)
    clock[0] = 1001.0
    watch.require_time()
    clock[0] = 1001.5  # a check of 1 s; a step of 0.5 s beside it would be too much
    watch.require_time(CHECKING)
    clock[0] = 1001.625
    with pytest.raises(OutOfTime):
        watch.require_time()


def test_time_that_went_by_before_counts(clock: list[float]) -> None:
    watch = TimeBudget(Budget(2.5), begun=999.0)
    clock[0] = 1001.5
    watch.require_time()
    with pytest.raises(OutOfTime):
        TimeBudget(Budget(2.5), begun=998.9).require_time()


def test_once_there_is_a_plan_less_time_will_do(clock: list[float]) -> None:
    watch = TimeBudget(Budget(2.5, with_plan=1.5))
    clock[0] = 1001.6
    watch.require_time()  # there is none yet
    watch.offer(Mock())
    with pytest.raises(OutOfTime, match=r"the time budget of 1\.5 s is used up"):
        watch.require_time()
    never_more = TimeBudget(Budget(2.5, with_plan=9.0))
    never_more.offer(Mock())
    clock[0] += 2.6
    with pytest.raises(OutOfTime, match=r"the time budget of 2\.5 s is used up"):
        never_more.require_time()


def test_what_used_the_time_is_told(clock: list[float]) -> None:
    watch = TimeBudget(Budget(10.0), begun=999.5, reserved=0.5)
    watch.require_time(CHECKING)
    for clock[0], phase in ((1000.25, "searching"), (1001.0, "refining"), (1008.0, "searching")):
        watch.require_time(phase)
    clock[0] = 1009.5
    with pytest.raises(OutOfTime) as end:
        watch.require_time("checking")
    assert end.value.used_for == (
        "0.50 s before the search, 0.25 s checking, 2.25 s searching, 7.00 s refining, "
        "0.50 s kept for the answer"
    )
    assert f"is used up ({end.value.used_for}); whether" in str(out_of_time(end.value))


def test_a_step_ends_where_its_check_would_come_too_late(clock: list[float]) -> None:
    """After a check of half a second, a step may take what is left before another one."""
    watch = TimeBudget(Budget(4.0), reserved=0.25)
    watch.require_time(CHECKING)
    clock[0] = 1000.5
    watch.require_time()
    assert watch.time_left() == 2.75
    clock[0] = 1003.5
    assert watch.time_left() == -0.25
    end = watch.cut_short()
    assert str(end) == "the time budget of 4 s is used up"
    assert end.used_for.endswith("0.50 s checking, 3.00 s searching, 0.25 s kept for the answer")
