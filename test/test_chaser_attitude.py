"""The chaser's attitude as a limit: kept by the search between the points too, or refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from dense_motion import truth
from shared_plans import planned

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.twin import seen_from

SETTINGS = load_parameters().planner
LENGTH, LIMIT = Objective(1.0, 0.0), 0.2


def limited(problem: PlanningProblem, angle: float, points: int = 50) -> PlanningProblem:
    limits = Limits(chaser_attitude=angle)
    return replace(problem, objective=LENGTH, points=points, limits=limits)


@pytest.mark.parametrize("points", [50, 13])
def test_a_plan_keeps_the_limit_between_its_points_too(
    lemur_capture: PlanningProblem, points: int
) -> None:
    problem = limited(lemur_capture, LIMIT, points)
    found = planned(problem, SETTINGS)
    assert LIMIT - 2e-3 < found.metrics.max_chaser_euler <= LIMIT
    assert LIMIT - 2e-3 < truth(problem, found.trajectory).chaser_attitude <= LIMIT


def test_the_limit_costs_joint_path(lemur_capture: PlanningProblem) -> None:
    free = planned(replace(lemur_capture, objective=LENGTH), SETTINGS)
    found = planned(limited(lemur_capture, LIMIT), SETTINGS)
    assert free.metrics.max_chaser_euler > LIMIT + 0.05
    assert free.metrics.joint_path_length < found.metrics.joint_path_length


def test_a_limit_that_is_far_away_changes_nothing(lemur_capture: PlanningProblem) -> None:
    free = plan(replace(lemur_capture, objective=LENGTH), SETTINGS)
    found = plan(limited(lemur_capture, 3.0), SETTINGS)
    assert found.xi.tobytes() == free.xi.tobytes()


def test_a_plan_beyond_the_limit_is_refused_with_time_and_amount(
    lemur_capture: PlanningProblem,
) -> None:
    free = plan(replace(lemur_capture, objective=LENGTH), SETTINGS)
    (failure,) = failures(limited(lemur_capture, LIMIT), free, SETTINGS)
    assert failure.status is Status.LIMIT_VIOLATED
    angle = free.metrics.max_chaser_euler
    assert f"the chaser has a largest Euler angle of {angle:.5g} rad" in failure.finding
    assert "at the goal, t = 10.00 s" in failure.finding
    assert f"{angle - LIMIT:.3g} rad beyond limits.chaser_attitude of 0.2 rad" in failure.finding
    assert not list(failures(limited(lemur_capture, angle + 1e-5), free, SETTINGS))


@pytest.mark.law("PLAN-11")
def test_a_turn_between_two_points_is_seen(lemur_capture: PlanningProblem) -> None:
    """The points keep the limit. Between the last two a joint swings and takes the chaser along."""
    found = plan(limited(lemur_capture, LIMIT), SETTINGS)
    swinging = found.trajectory.joint_velocities.copy()
    swinging[-2, 0], swinging[-1, 0] = 4.0, -4.0
    motion = replace(found.trajectory, joint_velocities=swinging)
    (failure,) = (
        failure
        for failure in failures(
            limited(lemur_capture, LIMIT), replace(found, trajectory=motion), SETTINGS
        )
        if failure.status is Status.LIMIT_VIOLATED
    )
    assert "largest Euler angle" in failure.finding
    assert "t = 9." in failure.finding


def test_a_limit_that_nothing_keeps_is_a_refusal_with_its_failures(
    lemur_capture: PlanningProblem,
) -> None:
    """The chaser drifts this far whatever the arm does."""
    with pytest.raises(NoPlanFound) as refusal:
        plan(limited(lemur_capture, 0.02, points=13), replace(SETTINGS, starts=2))
    assert any("limits.chaser_attitude" in found.finding for found in refusal.value.failures)
    assert refusal.value.status in {found.status for found in refusal.value.failures}


def test_the_limit_is_on_the_turn_since_the_start(lemur_capture: PlanningProblem) -> None:
    """A chaser that begins turned by more than the limit keeps it as one that does not."""
    frame = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 2.0), np.zeros(3))
    straight, turned = (
        perform(PlanningTask(problem, SETTINGS))
        for problem in (
            limited(lemur_capture, LIMIT),
            seen_from(limited(lemur_capture, LIMIT), frame),
        )
    )
    assert straight.metrics.max_chaser_euler <= LIMIT
    assert turned.metrics.max_chaser_euler == pytest.approx(
        straight.metrics.max_chaser_euler, abs=1e-6
    )


def test_rows_have_the_derivatives_of_differences(lemur_capture: PlanningProblem) -> None:
    problem = replace(limited(lemur_capture, LIMIT, points=9), obstacles=())
    program = path_program(problem, end_effector_paths(problem), SETTINGS)
    without = replace(program, problem=replace(problem, limits=Limits()))
    x, step = np.random.default_rng(0).normal(scale=0.05, size=18), 1e-6
    at_x = program.linearise(x)
    assert len(at_x.constraints) > len(without.linearise(x).constraints) + 20
    expected = np.stack(
        [
            (program.linearise(x + aside).constraints - program.linearise(x - aside).constraints)
            / (2 * step)
            for aside in step * np.eye(18)
        ],
        axis=1,
    )
    np.testing.assert_allclose(at_x.constraints_jacobian, expected, rtol=0.0, atol=1e-6)
