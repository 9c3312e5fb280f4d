"""The benchmark runs, and its tables say what was measured."""

import json
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from robots import LEMUR_SCENARIO

from ff_planner_benchmark.bench import columns, experiment, plans, times
from ff_planner_benchmark.bench.exact import ExactFunctions
from ff_planner_benchmark.bench.executed import BELIEFS
from ff_planner_benchmark.bench.methods import _optimality
from ff_planner_benchmark.bench.report import figures_json
from ff_planner_benchmark.cli import main
from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.optimisation.solver import minimise
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.scenario.scenario import load_scenario


@pytest.fixture(scope="module")
def lemur_capture():
    return load_scenario(LEMUR_SCENARIO)


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

    monkeypatch.setattr(experiment, "plan", no_plan)
    rows = list(plans.SCENARIO_PLANS.rows(2, settings))
    remark = "missed: ordinary lemur 0, turned: SINGULAR: the arm is stretched"
    assert remark in map(plans.SCENARIO_PLANS.remark, rows)
    assert {row[3] for row in plans.SCENARIO_PLANS.table(rows).rows} == {"0.0%"}
    assert {row["status"] for row in rows} == {"SINGULAR"}


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


def _timed_as(seconds):
    """Return a `timed_plan` that takes so long; None: there is no plan."""
    told = iter(seconds)

    def timed(_task):
        took = next(told)
        if took is None:
            return None, {"status": "COLLISION", "message": "none", "seconds": 9.0}
        made = SimpleNamespace(solver=SimpleNamespace(rollouts=1))
        return made, {"status": "SOLVED", "message": "", "seconds": took}

    return timed


@pytest.mark.parametrize(
    ("seconds", "warm_up", "median"),
    [((5.0, 1.0, 3.0), 1, 2.0), ((None, 1.0, 3.0), 1, 2.0), ((1.0, None, 4.0), 0, 2.5)],
)
def test_times_are_of_the_plans_after_those_that_warm_up(
    seconds, warm_up, median, lemur_capture, settings, monkeypatch
):
    monkeypatch.setattr(experiment, "timed_plan", _timed_as(seconds))
    plans, found = experiment.timed_plans([lemur_capture] * 3, settings, warm_up)
    assert found == median
    assert len(plans) == sum(one is not None for one in seconds)


def test_problems_without_a_plan_have_no_time_and_the_table_says_so(
    lemur_capture, settings, monkeypatch
):
    monkeypatch.setattr(experiment, "timed_plan", _timed_as([None, 1.0, None, 2.0]))
    with pytest.raises(NoPlanFound, match="none"):
        experiment.timed_plans([lemur_capture], settings)
    _, points, _ = times.SCALING
    first, second, third = times._growth(
        "points", ((size, [lemur_capture]) for size in (50, 100, 200)), settings, warm_up=0
    )
    rows = points.table([first, second, third]).rows
    assert rows == [
        ("50", "1.00", "1.000", "1"),
        ("100", "-", "-", "-"),
        ("200", "2.00", "2.000", "1"),
    ]
    rows = points.table([first | dict.fromkeys(("ratio", "seconds", "rollouts")), second]).rows
    assert rows == [("50", "-", "-", "-"), ("100", "-", "-", "-")]


@pytest.mark.parametrize(
    ("values", "shown"), [([None, 0.9, 0.5], "0.900"), ([None], "-"), ([], "-"), ([-1.0], "-1.000")]
)
def test_the_worst_of_known_values_is_shown_and_of_none_a_dash(values, shown):
    assert columns.value("miss", max)([{"miss": one} for one in values]) == shown


def test_figures_are_json_whatever_was_not_measured():
    def refuse(constant):
        raise ValueError(constant)

    figures = {"a": {"b": float("nan")}, "rows": [{"c": float("inf"), "d": (1.5, float("-inf"))}]}
    told = json.loads(figures_json(figures), parse_constant=refuse)
    assert told == {"a": {"b": None}, "rows": [{"c": None, "d": [1.5, None]}]}


def test_a_singular_path_is_worse_than_the_last_sound_one_by_as_much_each_time():
    """Whichever singular paths a solver has tried in between."""

    @dataclass(frozen=True)
    class At:
        value: float
        is_defined: bool
        max_terms: np.ndarray = field(default_factory=lambda: np.empty(0))

    program = SimpleNamespace(
        family=SimpleNamespace(variables=1), linearise=lambda x: At(float(x[0]), x[0] < 5.0)
    )
    functions = ExactFunctions(program)
    found = [functions.objective(np.array([x])) for x in (1.0, 6.0, 7.0, 6.0, 2.0, 8.0)]
    assert found == [1.0, 1001.0, 1001.0, 1001.0, 2.0, 1002.0]
