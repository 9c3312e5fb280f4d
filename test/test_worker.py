"""The solver in a process of its own."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem, Target
from ff_planner_ros.planning.settings import PlannerSettings, load_settings
from ff_planner_ros.ros.worker import Worker
from ff_planner_ros.share import share_directory


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_settings(share_directory() / "config" / "planner.yaml")


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with closing(Worker()) as worker:
        yield worker


LONG = 600.0  # [s] a budget that no plan uses up


class Loud:
    """Prints a line where it is unpickled, as a chatty library would."""

    def __reduce__(self) -> tuple[Any, ...]:
        return print, ("a line that is no answer",)


def test_a_plan_is_the_same_to_the_last_bit_as_without_it(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    here, there = plan(lemur_capture, settings), worker.solve(lemur_capture, settings, LONG)
    assert there.metrics == here.metrics
    np.testing.assert_array_equal(there.xi, here.xi)
    np.testing.assert_array_equal(there.trajectory.joint_positions, here.trajectory.joint_positions)


def test_errors_of_the_planner_come_across_as_they_are(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    target = Target(np.array([10.0, 0.0, 0.0]), lemur_capture.target.quaternion_xyzw)
    with pytest.raises(NoPlanFound) as too_far:
        worker.solve(replace(lemur_capture, target=target), settings, LONG)
    assert too_far.value.status is Status.GOAL_OUT_OF_REACH
    spheres = tuple(replace(sphere, radius=5.0) for sphere in lemur_capture.obstacles)
    with pytest.raises(InvalidInput, match="c1") as blocked:
        worker.solve(replace(lemur_capture, obstacles=spheres), settings, LONG)
    assert blocked.value.status is Status.START_IN_COLLISION


def test_a_budget_that_is_used_up_ends_the_search_and_nothing_else(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with pytest.raises(NoPlanFound, match=r"time budget of 1e-06 s is used up") as end:
        worker.solve(lemur_capture, settings, 1e-6)
    assert end.value.status is Status.OUT_OF_TIME
    assert worker.solve(lemur_capture, settings, LONG).metrics.min_clearance >= 0.0


def test_a_search_that_does_not_look_at_the_clock_is_ended_with_its_process(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    """A process that is stopped stands for one in the midst of a long iteration."""
    os.kill(worker._process.pid, signal.SIGSTOP)
    with pytest.raises(NoPlanFound, match=r"0\.01 s is used up within a single") as end:
        worker.solve(lemur_capture, settings, 0.01)
    assert end.value.status is Status.OUT_OF_TIME
    assert worker.solve(lemur_capture, settings, LONG).metrics.min_clearance >= 0.0


def test_an_error_that_nobody_foresaw_is_internal_and_ends_nothing(
    worker: Worker, lemur_capture: PlanningProblem, settings: Any
) -> None:
    with pytest.raises(FfPlannerError, match="the planner failed: AttributeError") as failure:
        worker.solve(lemur_capture, None, LONG)  # type: ignore[arg-type]
    assert failure.value.status is Status.INTERNAL_ERROR
    assert worker.solve(lemur_capture, settings, LONG).metrics.min_clearance >= 0.0


def test_what_a_library_prints_does_not_garble_the_answers(
    worker: Worker, settings: PlannerSettings
) -> None:
    with pytest.raises(FfPlannerError, match="the planner failed"):
        worker.solve(Loud(), settings, LONG)  # type: ignore[arg-type]


def test_a_closed_worker_says_so(lemur_capture: PlanningProblem, settings: PlannerSettings) -> None:
    worker = Worker()
    worker.close()
    worker.close()
    with pytest.raises(FfPlannerError, match="shut down"):
        worker.solve(lemur_capture, settings, LONG)
