"""The benchmark runs, and its tables say what was measured."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ff_planner_ros.bench import measurement, success
from ff_planner_ros.bench.beliefs import BELIEFS
from ff_planner_ros.bench.methods import _optimality
from ff_planner_ros.cli import main
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.optimisation.solver import minimise
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.problems import tumbling


@pytest.fixture(scope="module")
def settings():
    return load_parameters().planner


@pytest.mark.nightly
def test_the_quick_benchmark_prints_its_tables_and_writes_its_figures(tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert main(["bench", "--quick", "--scenarios", "1", "--json", str(tmp_path / "b.json")]) == 0
    printed = capfd.readouterr().out
    for part in (
        "machine",
        "1 core of",
        "OPENBLAS_NUM_THREADS=1",
        "min(Theta)",
        "direct (paper)",
        "fixed base",
    ):
        assert part in printed
    figures = json.loads((tmp_path / "b.json").read_text())
    assert {table["of"] for table in figures["tables"]} == set(figures) - {"machine", "tables"}
    assert {"date", "commit"} <= set(figures["machine"])
    assert {row["of"] for row in figures["scaling"]} == {"spheres", "points", "joints"}
    assert {row["kind"] for row in figures["scenarios"]} == {"ordinary", "cluttered"}
    solved = [row["kind"] for row in figures["families"] if row["status"] == "SOLVED"]
    assert {"ordinary", "cluttered", "planar", "singular starts"} <= set(solved)
    solved = [row["kind"] for row in figures["captures"] if row["status"] == "SOLVED"]
    assert set(solved) == set(tumbling.KINDS)
    assert {row["status"] for row in figures["free moments"]} == {"SOLVED"}
    assert max(row["of_witness"] for row in figures["free moments"]) < 1.02
    assert {row["status"] for row in figures["all features"]} == {"SOLVED"}
    assert {row["belief"] for row in figures["executions"]} == set(BELIEFS)
    assert all(
        row["shortest"] >= row["steadiest"] >= 0.9 * row["best_known"]
        for row in figures["steadiness"]
    )
    assert {row["method"] for row in figures["equal time"]} == {"ours", "SLSQP", "with restarts"}
    assert {row["search"] for row in figures["several cores"]} == {"least attitude", "all features"}
    ours = [row for row in figures["methods"] if row["method"] == "ff_planner"]
    assert [row["objective"] for row in ours] == ["min(L)", "min(Theta)", "L + Theta"]
    assert all(row["clearance"] > 0.0 and row["seconds"] > 0.0 for row in ours)


def test_a_miss_is_counted_and_told_with_its_cause(settings, monkeypatch):
    def no_plan(*_):
        raise NoPlanFound(Status.SINGULAR, "the arm is stretched")

    monkeypatch.setattr(measurement, "plan", no_plan)
    found = success.measurement(2, settings)
    remark = "missed: ordinary lemur 0, turned: SINGULAR: the arm is stretched"
    assert remark in found.remarks
    assert {row[3] for row in found.tables[0].rows} == {"0.0%", "-"}
    assert {each.status for each in found.results} == {Status.SINGULAR}


def test_numbers_stand_to_the_right_and_words_to_the_left(capsys):
    print_table("Title", ("word", "number"), [("a", "-1.5"), ("abc", "10.0%")])
    assert capsys.readouterr().out == "\nTitle\nword  number\na       -1.5\nabc    10.0%\n"


def test_optimality_of_another_method_is_the_solvers_own_at_its_optimum(lemur_capture, settings):
    program = path_program(lemur_capture, end_effector_paths(lemur_capture), settings)
    solution = minimise(program.linearise, np.zeros(18), 100, 1e-5, 0.0)
    assert solution.converged
    assert _optimality(program, solution.x) < 1e-3
    assert _optimality(program, np.zeros(18)) > 1e-2


def test_optimality_where_the_attitude_counts_asks_the_peaks_multipliers_to_sum_to_one(
    lemur_capture, settings
):
    asked = replace(lemur_capture, objective=Objective(0.0, 1.0))
    program = path_program(asked, end_effector_paths(asked), settings)
    assert _optimality(program, np.zeros(18)) > 0.1
