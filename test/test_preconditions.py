"""Values at a limit: what is beyond it by rounding passes, what is beyond it by more does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_motion import joints_between
from judging import require_sound

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Limits, Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import smallest_singular_values

SETTINGS = load_parameters().planner
ROUNDING, MORE = 9e-7, 1.1e-6
PAPERS = Parametrisation.END_EFFECTOR_POLYNOMIAL
EXCESS = {"position": 1e-4, "rate": 1e-4}  # that a plan may have [rad, parts of the limit]


def with_limits(problem: PlanningProblem, **limits: Array) -> PlanningProblem:
    robot = replace(problem.robot, **limits)
    return replace(
        problem, robot=robot, limits=Limits(joint_velocities="velocity_limits" in limits)
    )


def start_beyond(problem: PlanningProblem, limit: str, excess: float) -> PlanningProblem:
    """The capture by a robot whose limits its start exceeds, at every joint.

    Joints at their position limits stand still: none of them moves further beyond.
    """
    positions, rates = problem.start.joint_positions, problem.start.joint_velocities
    if limit != "velocity_limits":
        start = replace(problem.start, joint_velocities=np.zeros_like(rates))
        problem = replace(problem, start=start)
    beyond = {
        "upper_position_limits": positions - excess,
        "lower_position_limits": positions + excess,
        "velocity_limits": np.abs(rates) - excess,
    }
    return with_limits(problem, **{limit: beyond[limit]})


@pytest.mark.law("PLAN-25")
@pytest.mark.parametrize(
    ("limit", "words", "allowed"),
    [
        ("upper_position_limits", r"joints\.position\[joint_\d\]", 1e-4),
        ("lower_position_limits", r"joints\.position\[joint_\d\]", 1e-4),
        ("velocity_limits", r"joints\.velocity\[joint_\d\]", 1e-6),  # the slowest joint
    ],
)
def test_a_start_beyond_its_limits_by_what_plans_may_be_is_not_refused(
    lemur_capture: PlanningProblem, limit: str, words: str, allowed: float
) -> None:
    require_plannable(start_beyond(lemur_capture, limit, 0.9 * allowed), SETTINGS)
    with pytest.raises(InvalidInput, match=words) as refused:
        require_plannable(start_beyond(lemur_capture, limit, 1.1 * allowed), SETTINGS)
    assert refused.value.status is Status.START_OUTSIDE_LIMITS


def with_threshold(smallest: float) -> PlannerSettings:
    return replace(SETTINGS, singular_value_threshold=smallest)


def test_a_start_as_near_to_a_singularity_as_allowed_but_for_rounding_is_not_refused(
    lemur_capture: PlanningProblem,
) -> None:
    q, _ = configuration(lemur_capture.robot, lemur_capture.start)
    smallest = float(smallest_singular_values(lemur_capture.robot, q[None])[0])
    papers = Parametrisation.END_EFFECTOR_POLYNOMIAL
    problem = replace(lemur_capture, parametrisation=papers)
    require_plannable(problem, with_threshold(smallest + ROUNDING))
    with pytest.raises(InvalidInput) as refused:
        require_plannable(problem, with_threshold(smallest + MORE))
    assert refused.value.status is Status.START_SINGULAR


@pytest.mark.sampled
@pytest.mark.parametrize("beyond", [ROUNDING, 1.5e-5, 0.9e-4])
@pytest.mark.parametrize("family", [PAPERS, Parametrisation.JOINT_SPLINE])
def test_a_plan_is_found_from_a_start_beyond_a_limit_by_what_plans_may_be(
    lemur_capture: PlanningProblem, beyond: float, family: Parametrisation
) -> None:
    """Its rate leads away from the limit, which it would leave behind otherwise."""
    upper = lemur_capture.robot.upper_position_limits.copy()
    joint = int(lemur_capture.start.joint_velocities.argmin())
    upper[joint] = lemur_capture.start.joint_positions[joint] - beyond
    problem = with_limits(lemur_capture, upper_position_limits=upper)
    answer = plan(replace(problem, parametrisation=family), SETTINGS)
    least = answer.metrics.min_joint_margin
    if family is PAPERS:  # whose paths do not choose the accelerations at the start
        assert -1e-4 <= least <= -beyond + 1e-12
    else:
        assert least == pytest.approx(-beyond, abs=1e-12)


def test_a_plan_is_found_from_a_start_that_is_too_fast_by_what_plans_may_be(
    lemur_capture: PlanningProblem,
) -> None:
    """With joint splines: the paper's paths do not choose the accelerations at the start."""
    joint = int(np.abs(lemur_capture.start.joint_velocities).argmax())
    limits = np.full(7, 1.0)
    limits[joint] = np.abs(lemur_capture.start.joint_velocities[joint]) / (1.0 + 0.9e-4)
    problem = with_limits(lemur_capture, velocity_limits=limits)
    splines = Parametrisation.JOINT_SPLINE
    answer = plan(replace(problem, parametrisation=splines, duration=20.0), SETTINGS)
    least = answer.metrics.min_velocity_margin
    assert least == pytest.approx(-0.9e-4 * limits[joint], rel=1e-3)


@pytest.mark.parametrize(
    ("quantity", "status"),
    [
        ("position", Status.LIMIT_VIOLATED),
        ("rate", Status.LIMIT_VIOLATED),
        ("torque", Status.TORQUE_TOO_HIGH),
        ("singular value", Status.SINGULAR),
        ("start velocity jump", Status.CHECK_FAILED),
    ],
)
def test_a_plan_beyond_a_limit_by_what_is_allowed_passes_the_check(
    lemur_capture: PlanningProblem, lemur_plan: Plan, quantity: str, status: Status
) -> None:
    allowed = EXCESS.get(quantity, 1e-6)
    require_sound(*beyond(lemur_capture, lemur_plan, quantity, 0.9 * allowed))
    with pytest.raises(NoPlanFound) as refused:
        require_sound(*beyond(lemur_capture, lemur_plan, quantity, 1.1 * allowed))
    assert refused.value.status is status


def beyond(
    problem: PlanningProblem, answer: Plan, quantity: str, excess: float
) -> tuple[PlanningProblem, Plan, PlannerSettings]:
    """The capture with its limits moved so that the plan exceeds one of them."""
    motion, settings = answer.trajectory, SETTINGS
    _, positions, rates, _ = joints_between(motion, 1000)
    if quantity == "position":
        upper = positions.max(axis=0) - excess
        problem = with_limits(problem, upper_position_limits=upper)
    elif quantity == "rate":
        fastest = np.abs(rates).max(axis=0)
        problem = with_limits(problem, velocity_limits=fastest / (1.0 + excess))
    elif quantity == "torque":
        peaks = np.array(answer.metrics.peak_joint_torques)
        problem = with_limits(problem, effort_limits=peaks - excess)
    elif quantity == "singular value":
        smallest = answer.metrics.min_singular_value
        settings = replace(settings, singular_value_threshold=smallest + excess)
    else:
        jump = np.zeros(7)
        jump[2] = settings.start_velocity_tolerance + excess
        at_start = problem.start.joint_velocities + jump
        problem = replace(problem, start=replace(problem.start, joint_velocities=at_start))
        # Other start rates are another momentum; that is not the question here.
        settings = replace(settings, momentum_tolerance=1.0)
    return problem, replace(answer, metrics=measure(problem, motion, settings)), settings
