"""The tables of a comparison, against numbers worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import SOUND, drawn_plan

from ff_planner_ros.analysis.comparison import (
    COLUMNS,
    RATIO_COLUMNS,
    Answer,
    comparison_rows,
    findings,
    ratio_rows,
)
from ff_planner_ros.analysis.methods import (
    FIXED_BASE,
    POTENTIAL_FIELD,
    SHORTEST,
    STEADIEST,
    STRAIGHT_LINE,
    Method,
)
from ff_planner_ros.errors import Failure, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot

OUT_OF_REACH = NoPlanFound(Status.GOAL_OUT_OF_REACH, "target.position is 9 m away")


def answer(robot: Robot, *failures: Failure, **changes: float) -> Answer:
    plan = replace(drawn_plan(robot, seed=1), metrics=replace(SOUND, **changes))
    return Answer(plan, failures, seconds=1.234)


def table(problem: PlanningProblem, answers: dict[Method, Answer]) -> dict[str, dict[str, str]]:
    """Cells by method and column."""
    rows = list(comparison_rows(problem, answers))
    assert {len(row) for row in rows} == {len(COLUMNS)}
    return {row[0]: dict(zip(COLUMNS, row, strict=True)) for row in rows}


def test_a_row_holds_the_methods_metrics_in_the_units_of_the_header(
    lemur_capture: PlanningProblem,
) -> None:
    rows = table(lemur_capture, {SHORTEST: answer(lemur_capture.robot)})
    assert rows["min(L)"] == {
        "method": "min(L)",
        "joint path [rad]": "1.5000",
        "Euler angle [deg]": "12.00",
        "clearance [mm]": "12.3",
        "peak torque [N m]": "2.25",
        "miss [mm]": "0.40",
        "miss [deg]": "0.020",
        "time [s]": "1.23",
        "check": "passed",
    }


def test_without_obstacles_there_is_no_clearance(
    lemur_capture: PlanningProblem,
) -> None:
    alone = replace(lemur_capture, obstacles=())
    answers = {SHORTEST: answer(alone.robot, min_clearance=np.inf)}
    assert table(alone, answers)["min(L)"]["clearance [mm]"] == "-"


def test_a_motion_that_fails_the_check_is_shown_with_each_cause_once(
    lemur_capture: PlanningProblem,
) -> None:
    bad = answer(
        lemur_capture.robot,
        Failure(Status.COLLISION, "the arm is 0.0129 m inside obstacle c1", ()),
        Failure(Status.CHECK_FAILED, "final_position_error is 0.4 m", ()),
        Failure(Status.CHECK_FAILED, "final_orientation_error is 0.3 rad", ()),
        min_clearance=-0.0129,
        final_position_error=0.4,
        final_orientation_error=0.3,
    )
    answers = {STRAIGHT_LINE: answer(lemur_capture.robot), FIXED_BASE: bad}
    row = table(lemur_capture, answers)["fixed base"]
    assert row["clearance [mm]"] == "-12.9"
    assert row["miss [mm]"] == "400.00"
    assert row["check"] == "collision, check_failed"
    (finding,) = findings(answers)
    assert finding.startswith("fixed base: ")
    assert "obstacle" in finding
    assert "final_position_error is 0.4 m" in finding
    assert finding.endswith("(drawn by hand)")


@pytest.mark.parametrize(
    "refusal",
    [OUT_OF_REACH, InvalidInput(Status.START_SINGULAR, "joints.position", [0.0], "not singular")],
)
def test_a_method_without_a_motion_keeps_its_row_and_tells_its_cause(
    refusal: NoPlanFound | InvalidInput, lemur_capture: PlanningProblem
) -> None:
    answers = {SHORTEST: Answer(refusal, (), 2.0), STEADIEST: answer(lemur_capture.robot)}
    rows = table(lemur_capture, answers)
    cells = list(rows["min(L)"].values())
    assert cells == ["min(L)", *["-"] * 6, "2.00", refusal.status.name.lower()]
    assert rows["min(Theta)"]["check"] == "passed"
    assert list(findings(answers)) == [f"min(L): {refusal}"]


# Joint path [rad] and attitude [deg] that the paper's percentages make of a straight line of 1 rad
# and 10 deg.
AS_PRINTED = {
    STRAIGHT_LINE: (1.0, 10.0),
    SHORTEST: (0.9735, 6.654 / 0.8176),
    STEADIEST: (0.9735 / 0.6763, 6.654),
    POTENTIAL_FIELD: (0.9735 * 2.78, 6.654 / 0.2937),
}


def test_ratios_of_the_papers_own_numbers_are_those_it_prints(lemur: Robot) -> None:
    answers = {
        method: answer(lemur, joint_path_length=length, max_chaser_euler=np.deg2rad(angle))
        for method, (length, angle) in AS_PRINTED.items()
    }
    rows = list(ratio_rows(answers))
    assert {len(row) for row in rows} == {len(RATIO_COLUMNS)}
    assert {words: paper for words, paper, _ in rows} == {
        "joint path, min(L) / straight line": "0.974",
        "joint path, min(L) / min(Theta)": "0.676",
        "joint path, APF / min(L)": "2.780",
        "attitude, min(Theta) / straight line": "0.665",
        "attitude, min(Theta) / APF": "0.294",
        "attitude, min(Theta) / min(L)": "0.818",
    }
    for words, paper, here in rows:
        assert float(here) == pytest.approx(float(paper), abs=6e-4), words


def test_a_ratio_is_ours_over_ours_and_left_out_where_one_is_missing(lemur: Robot) -> None:
    answers = {
        STRAIGHT_LINE: answer(lemur, joint_path_length=2.0, max_chaser_euler=0.4),
        POTENTIAL_FIELD: Answer(OUT_OF_REACH, (), 1.0),
        SHORTEST: answer(lemur, joint_path_length=1.0, max_chaser_euler=0.5),
        STEADIEST: answer(lemur, joint_path_length=8.0, max_chaser_euler=0.1),
    }
    here = [row[2] for row in ratio_rows(answers)]
    assert here == ["0.500", "0.125", "-", "0.250", "-", "0.200"]
