"""The time budget, on a clock that the test winds."""

from __future__ import annotations

from unittest.mock import Mock

import pytest

from ff_planner_ros import time_budget as module
from ff_planner_ros.errors import OutOfTime, Status
from ff_planner_ros.planning.check.check import out_of_time
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.time_budget import TimeBudget


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that shows its only entry."""
    shown = [1000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: shown[0])
    return shown


def test_a_budget_lasts_until_it_is_used_up(clock: list[float]) -> None:
    watch = TimeBudget(Budget(2.5))
    for clock[0] in (1000.0, 1001.0, 1001.5):  # a step takes no longer than the last ones
        watch.require_time()
    clock[0] = 1001.6
    with pytest.raises(OutOfTime, match=r"the time budget of 2\.5 s is used up") as end:
        watch.require_time()
    assert end.value.status is Status.TIMED_OUT


def test_time_that_went_by_before_counts(clock: list[float]) -> None:
    watch = TimeBudget(Budget(2.5), begun=999.0)
    clock[0] = 1001.4
    watch.require_time()
    clock[0] = 1001.6
    with pytest.raises(OutOfTime):
        watch.require_time()


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
    for clock[0], phase in ((1000.25, "searching"), (1001.0, "refining"), (1008.0, "searching")):
        watch.require_time(phase)
    clock[0] = 1009.5
    with pytest.raises(OutOfTime) as end:
        watch.require_time("checking")
    assert end.value.used_for == (
        "0.50 s before the search, 2.25 s searching, 7.00 s refining, 0.50 s kept for the answer"
    )
    assert f"is used up ({end.value.used_for}); whether" in str(out_of_time(end.value))
