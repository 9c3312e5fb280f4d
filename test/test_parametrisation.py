"""Which path family a plan is of: the paper's where it applies, joint splines elsewhere."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import LEMUR_SCENARIO
from shared_plans import planned

from ff_planner_benchmark.problems.witnessed import SINGULAR, drawn
from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Objective, Parametrisation, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import smallest_singular_values
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
LENGTH = Objective(1.0, 0.0)
PAPERS, SPLINES = Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE


@pytest.fixture(scope="module")
def shortest() -> PlanningProblem:
    """The paper's capture on its shortest joint path."""
    return replace(load_scenario(LEMUR_SCENARIO), objective=LENGTH)


def test_left_to_the_planner_the_paths_are_the_papers_where_they_apply(
    shortest: PlanningProblem,
) -> None:
    left, papers = planned(shortest, SETTINGS), planned(in_family(shortest, PAPERS), SETTINGS)
    assert left.family == papers.family == "end_effector_polynomial"
    assert left.coefficients.tobytes() == papers.coefficients.tobytes()


def in_family(asked: PlanningProblem, family: Parametrisation) -> PlanningProblem:
    return replace(asked, parametrisation=family)


def test_freedom_in_time_makes_the_joint_path_shorter(shortest: PlanningProblem) -> None:
    papers, splines = (planned(in_family(shortest, f), SETTINGS) for f in (PAPERS, SPLINES))
    assert splines.family == "joint_spline"
    assert splines.xi.size == 0
    ratio = splines.metrics.joint_path_length / papers.metrics.joint_path_length
    assert 0.9 < ratio < 0.97


def test_the_plan_itself_is_a_first_guess_that_leads_to_it_again(
    shortest: PlanningProblem,
) -> None:
    """Left to the planner, too, a guess is tried in the family that has as many variables."""
    first = plan(in_family(shortest, SPLINES), SETTINGS)
    alone = replace(SETTINGS, starts=1)
    # The first search may end a little before the optimum; one that begins there ends at it.
    second = plan(in_family(shortest, SPLINES), alone, first_guess=first.coefficients)
    again = plan(in_family(shortest, SPLINES), alone, first_guess=second.coefficients)
    lengths = [found.metrics.joint_path_length for found in (first, second, again)]
    assert lengths[1] <= (1.0 + 1e-4) * lengths[0]
    assert lengths[2] == pytest.approx(lengths[1], rel=1e-4)
    assert second.solver.iterations < first.solver.iterations
    with pytest.raises(InvalidInput) as refusal:
        plan(shortest, SETTINGS, first_guess=np.zeros(55))
    assert refusal.value.field == "first_guess"


@pytest.mark.law("PLAN-12")
@pytest.mark.parametrize("number", range(3))
def test_from_a_singular_start_the_plan_comes_true(number: int) -> None:
    """Three arms; executed open loop in another physics engine, where the end effector arrives."""
    asked = drawn("singular starts", number).problem
    q, _ = configuration(asked.robot, asked.start)
    assert smallest_singular_values(asked.robot, q[None])[0] < SINGULAR
    found = perform(PlanningTask(asked, SETTINGS))
    assert found.family == "joint_spline"
    with pytest.raises(InvalidInput) as refusal:
        plan(in_family(asked, PAPERS), SETTINGS)
    assert refusal.value.status is Status.START_SINGULAR
    assert verify(asked.robot, found.trajectory).passed


def test_where_the_papers_paths_hold_no_plan_joint_splines_are_tried(
    shortest: PlanningProblem,
) -> None:
    """A goal at the edge of the workspace, with one start for either family."""
    target = replace(shortest.target, position=np.array([3.6, 0.4, 0.6]))
    edge = replace(shortest, target=target, obstacles=())
    alone = replace(SETTINGS, starts=1)
    with pytest.raises(NoPlanFound):
        plan(in_family(edge, PAPERS), alone)
    assert plan(edge, alone).family == "joint_spline"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("planar", "planar base|2 joints"),
        ("partial goals", "leaves the orientation free"),
    ],
)
def test_the_papers_paths_are_refused_for_what_they_are_not_made_for(kind: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as refusal:
        plan(in_family(drawn(kind, 0).problem, PAPERS), SETTINGS)
    assert refusal.value.field == "parametrisation"
    assert refusal.value.status is Status.UNSUPPORTED


def test_a_plan_of_joint_splines_is_continued_after_its_goal(shortest: PlanningProblem) -> None:
    task = PlanningTask(in_family(shortest, SPLINES), SETTINGS)
    for end in (EndBehaviour.HOLD_END_EFFECTOR, EndBehaviour.STOP_JOINTS):
        whole = perform(replace(task, end_behaviour=end, tail=2.0))
        assert whole.trajectory.time[-1] == pytest.approx(shortest.duration + 2.0)
        assert whole.family == "joint_spline"


def test_a_scenario_and_the_command_line_name_the_family_and_the_answer_says_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = LEMUR_SCENARIO.read_text().replace(
        "../robots", str(LEMUR_SCENARIO.parents[1] / "robots")
    )
    scenario, answer = tmp_path / "scenario.yaml", tmp_path / "answer.json"
    scenario.write_text(text + "\nparametrisation: joint_spline\n")
    command = ["plan", str(scenario), "--objective", "length", "--json", str(answer)]
    for more, family in (
        ([], "joint_spline"),
        (["--parametrisation", "end_effector_polynomial"], "end_effector_polynomial"),
    ):
        assert main([*command, *more]) == 0
        assert json.loads(answer.read_text())["parametrisation"] == family
        assert family in capsys.readouterr().out
    scenario.write_text(text + "\nparametrisation: splines\n")
    with pytest.raises(InvalidInput, match="auto, end_effector_polynomial or joint_spline"):
        load_scenario(scenario)


@pytest.mark.parametrize("method", ["straight", "apf"])
def test_baselines_are_refused_where_they_are_not_defined(
    method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = LEMUR_SCENARIO.parent / "planar_capture.yaml"
    assert main(["plan", str(scenario), "--method", method]) == 2
    assert "with an arm of 3 joints only the planner itself will do" in capsys.readouterr().err
