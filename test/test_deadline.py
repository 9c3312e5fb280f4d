"""A deadline ends an evaluation of the core wherever it is, and the search replays to the step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from test_anytime import EndingAt, answered, same

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import EndedBy, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.watch import Aside, Steps, Watch
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask

SETTINGS = load_parameters().planner
SCENARIOS = share_directory() / "config" / "scenarios"


class CuttingShort(Watch):
    """Has time for some steps, and none for the one after these."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.begun = 0

    def time_left(self) -> float:
        self.begun += 1
        return 0.0 if self.begun > self.steps else math.inf


@pytest.fixture(scope="module", params=["lemur_capture", "lemur_capture_bodies"])
def problem(request: pytest.FixtureRequest) -> PlanningProblem:
    """One of lines, and one of shapes."""
    return load_scenario(SCENARIOS / f"{request.param}.yaml")


@pytest.mark.parametrize("of_joints", [False, True])
def test_an_evaluation_ends_at_its_deadline_and_only_there(
    problem: PlanningProblem, of_joints: bool
) -> None:
    family = joint_splines(problem, SETTINGS) if of_joints else end_effector_paths(problem)
    program, x = path_program(problem, family, SETTINGS).in_core, np.zeros(family.variables)
    whole = program.at(x).constraints
    with pytest.raises(compiled.DeadlineOver, match="deadline is over"), compiled.Deadline(0.0):
        program.at(x)
    for seconds in (1e3, 1e300):
        with compiled.Deadline(seconds):
            assert np.array_equal(program.at(x).constraints, whole)
    assert np.array_equal(program.at(x).constraints, whole)


@pytest.mark.parametrize("steps", [0, 1, 5, 12])
def test_a_search_whose_time_ends_within_a_step_is_replayed_to_that_step(
    problem: PlanningProblem, steps: int
) -> None:
    """Nothing of the step counts: the answer is that of a search which ends before it."""
    task = PlanningTask(replace(problem, objective=Objective(1.0, 0.0)), SETTINGS)
    watch = CuttingShort(steps)
    found, refused = answered(task, watch)
    told = found or refused
    assert told is not None
    assert watch.begun == steps + 1, "nothing is evaluated after that"
    assert told.effort >= steps + 1  # checks are steps, too
    again = [answered(task.ended_at(told.effort), Watch()), answered(task, EndingAt(told.effort))]
    for found_again, refused_again in again:
        if found is not None:
            assert found_again is not None
            assert same(found, found_again)
            assert found.solver.ended_by is EndedBy.DEADLINE
        else:
            assert refused is not None
            assert refused_again is not None
            assert refused_again.effort == refused.effort
            assert refused.status is refused_again.status is Status.TIMED_OUT
            attempts = [one.attempt for one in (refused, refused_again)]
            assert (attempts[0] is None) == (attempts[1] is None)
            if attempts[0] is not None:
                assert same(*attempts)
                assert attempts[0].solver == attempts[1].solver


@pytest.mark.parametrize("within", [Steps, Aside])
def test_a_watch_that_passes_on_passes_on_what_is_left(
    within: Callable[[Watch], Steps | Aside],
) -> None:
    watch = within(CuttingShort(1))
    assert [watch.time_left() for _ in range(2)] == [math.inf, 0.0]
    assert watch.cut_short().ended_by is EndedBy.DEADLINE
