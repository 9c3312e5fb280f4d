"""What open loop makes of a wrong model: rows that a formula or a law foretells."""

from __future__ import annotations

import re
from dataclasses import astuple, replace

import numpy as np
import pytest

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.simulation.deviation import Deviation
from ff_planner_ros.simulation.model_errors import ModelError, model_errors
from ff_planner_ros.simulation.verification import verify

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def rows(lemur_capture: PlanningProblem, lemur_plan: Plan) -> tuple[ModelError, ...]:
    return model_errors(lemur_capture.robot, lemur_plan.trajectory)


def deviations(rows: tuple[ModelError, ...], cause: str) -> list[Deviation]:
    """Return the deviations of every row whose cause matches, at least one."""
    found = [row.deviation for row in rows if re.fullmatch(cause, row.cause)]
    assert found, cause
    return found


@pytest.mark.nightly
def test_every_cause_has_one_row(rows: tuple[ModelError, ...]) -> None:
    assert len({row.cause for row in rows}) == len(rows) == 20


def test_with_nothing_wrong_the_plan_comes_true(
    lemur_capture: PlanningProblem, lemur_plan: Plan, rows: tuple[ModelError, ...]
) -> None:
    (nothing,) = deviations(rows, "nothing")
    assert astuple(nothing) == pytest.approx(
        astuple(verify(lemur_capture.robot, lemur_plan.trajectory).deviation), abs=1e-6
    )


@pytest.mark.parametrize(
    "family",
    [
        "arm .* heavier, inertias too",
        "chaser .* heavier, inertias too",
        "every mass and inertia within .*",
        "viscous friction, .*",
        "dry friction, .*",
    ],
)
def test_an_error_of_1_5_and_10_percent_leads_further_astray_each_time(
    rows: tuple[ModelError, ...], family: str
) -> None:
    one, five, ten = deviations(rows, family)
    for name in ("final_position_error", "max_chaser_position_error"):
        errors = [getattr(off, name) for off in (one, five, ten)]
        assert 1e-4 < errors[0] < errors[1] < errors[2]


def test_a_small_error_of_the_mass_leads_astray_in_proportion(
    rows: tuple[ModelError, ...],
) -> None:
    one, five, _ = deviations(rows, "chaser .* heavier, inertias too")
    for small, large in zip(astuple(one), astuple(five), strict=True):
        assert large == pytest.approx(5 * small, rel=0.1)


def test_the_end_effector_feels_a_heavier_arm_more_than_a_heavier_chaser(
    rows: tuple[ModelError, ...],
) -> None:
    arm, chaser = (deviations(rows, f"{part} 1% heavier, .*")[0] for part in ("arm", "chaser"))
    assert arm.final_position_error > 5 * chaser.final_position_error
    assert chaser.max_chaser_orientation_error > 2 * arm.max_chaser_orientation_error


def test_a_chaser_that_drifts_faster_takes_everything_along(
    lemur_capture: PlanningProblem, rows: tuple[ModelError, ...]
) -> None:
    """1 mm/s over 10 s are 10 mm, whatever the arm does: physics looks the same from a train."""
    (off,) = deviations(rows, "chaser 1 mm/s off at the start")
    (nothing,) = deviations(rows, "nothing")
    assert off.final_position_error == pytest.approx(1e-3 * lemur_capture.duration, rel=1e-4)
    assert off.max_chaser_position_error == pytest.approx(1e-3 * lemur_capture.duration, rel=1e-4)
    assert off.final_orientation_error == pytest.approx(nothing.final_orientation_error, abs=1e-7)


def test_a_chaser_that_turns_faster_is_turned_further_at_the_end(
    lemur_capture: PlanningProblem, rows: tuple[ModelError, ...]
) -> None:
    (off,) = deviations(rows, "chaser 0.01 deg/s off at the start")
    turned_deg = np.rad2deg(off.max_chaser_orientation_error)
    assert turned_deg == pytest.approx(0.01 * lemur_capture.duration, rel=0.1)


@pytest.mark.nightly
def test_the_study_comes_to_the_same_every_time(
    lemur_capture: PlanningProblem, lemur_plan: Plan, rows: tuple[ModelError, ...]
) -> None:
    assert model_errors(lemur_capture.robot, lemur_plan.trajectory) == rows


def test_samples_that_cannot_be_executed_are_refused(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    motion = replace(lemur_plan.trajectory, joint_torques=np.ones((50, 6)))
    with pytest.raises(InvalidInput, match="joint_torques"):
        model_errors(lemur_capture.robot, motion)
