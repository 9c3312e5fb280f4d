"""The report of a study: every quantity and metric, the worst cases, and pages of single plans."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import study
from read_page import Page
from robots import CONFIG

from ff_planner_ros.baselines import METHODS
from ff_planner_ros.campaign import run
from ff_planner_ros.campaign.again import command_again, scenario_again
from ff_planner_ros.campaign.cases import cases, kinds_of_values
from ff_planner_ros.campaign.methods import method_of
from ff_planner_ros.campaign.study import Study
from ff_planner_ros.campaign.table import Writer, plan_schema
from ff_planner_ros.campaign.work import Outcome, run_case
from ff_planner_ros.cli import main
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.metrics import METRICS
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.report.statistics import Group, grouped
from ff_planner_ros.report.study.case import save_case
from ff_planner_ros.report.study.columns import quantities, unit_of
from ff_planner_ros.report.study.page import _verdict
from ff_planner_ros.report.study.worst import worst_cases

SPIN, TURN, DURATION = "chaser.angular_velocity", "turn.target.z", "duration"
GRID = {DURATION: [2.0, 2.5], SPIN: {"times": [0.5, 2.0]}, TURN: [0.0, 5.0, 179.0]}


class Campaign:
    """The directory of a campaign, written without a cluster."""

    def __init__(self, asked: Study, directory: Path) -> None:
        self.directory = directory
        directory.mkdir()
        run._keep_sources(asked, directory)
        writer = Writer(directory, plan_schema(kinds_of_values(asked)))
        self.rows = [run_case(case).row for case in cases(asked)]
        writer.add([Outcome(row, []) for row in self.rows])
        writer.flush()

    def page(self, *options: str) -> Page:
        assert main(["campaign", "report", str(self.directory), *options]) == 0
        return Page((self.directory / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    directory = tmp_path_factory.mktemp("grid")
    methods = [{"name": "ours"}, {"name": "line", "method": "straight"}]
    asked = study(directory, variations={"grid": GRID}, methods=methods)
    return Campaign(asked, directory / "out")


@pytest.fixture(scope="module")
def told(grid: Campaign) -> dict[str, Any]:
    """What the pictures of its page are drawn of."""
    return dict(grid.page("--plans", "0").data["study-cases"])


def column(told: Mapping[str, Any], name: str) -> list[Any]:
    return next(
        one["values"] for one in told["quantities"] + told["metrics"] if one["name"] == name
    )


def test_every_quantity_is_there_vectors_by_norm_and_components(
    grid: Campaign, told: dict[str, Any]
) -> None:
    spins = [row[f"change.{SPIN}"] for row in grid.rows]
    moving = [k for k in range(3) if len({spin[k] for spin in spins}) > 1]
    names = [f"|{SPIN}| [rad/s]", *(f"{SPIN}[{k}] [rad/s]" for k in moving)]
    others = [f"{DURATION} [s]", f"{TURN} [deg]"]
    assert [one["name"] for one in told["quantities"]] == [*names, *others]
    assert column(told, names[0]) == pytest.approx(np.linalg.norm(spins, axis=1), rel=1e-5)
    for name, k in zip(names[1:], moving, strict=True):
        assert column(told, name) == pytest.approx([spin[k] for spin in spins], rel=1e-5)
    assert column(told, f"{TURN} [deg]") == [row[f"change.{TURN}"] for row in grid.rows]


def test_every_metric_that_plans_have_is_there_in_the_units_of_tables(
    grid: Campaign, told: dict[str, Any]
) -> None:
    known = {m.label for m in METRICS if any(r.get(m.name) not in (None, []) for r in grid.rows)}
    assert len(known) > 10
    assert {one["name"].partition(" [")[0] for one in told["metrics"]} == known | {"time"}
    turns = [None if not r["solved"] else np.rad2deg(r["max_chaser_euler"]) for r in grid.rows]
    found = column(told, "largest chaser Euler angle [deg]")
    assert [one is None for one in found] == [one is None for one in turns]
    of_plans = [one for one in found if one is not None]
    assert of_plans == pytest.approx([one for one in turns if one is not None], rel=1e-5)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("obstacles.c1.radius", "m"),
        ("target.position[0]", "m"),
        ("phases[0].duration", "s"),
        ("urdf.chaser.mass", "kg"),
        ("points", ""),
        ("no.such.key", ""),
    ],
)
def test_a_quantity_has_the_unit_of_the_schema(key: str, unit: str) -> None:
    assert unit_of(key) == unit


def test_words_are_a_quantity_and_what_does_not_vary_is_none() -> None:
    words = ['"auto"', '"paper"', '"auto"']
    rows = [{"change.parametrisation": word, "change.points": 30.0} for word in words]
    (found,) = quantities(rows)
    assert (found.name, found.labels, found.values) == (
        "parametrisation",
        ["auto", "paper"],
        [0, 1, 0],
    )


def test_intervals_are_of_random_draws_alone(grid: Campaign, tmp_path: Path) -> None:
    page = grid.page("--plans", "0")
    assert "interval" not in page.words
    assert page.data["study-cases"]["drawn"] is False
    drawn = Campaign(study(tmp_path, methods=[{"name": "ours"}]), tmp_path / "out")
    page = drawn.page("--plans", "0")
    assert page.row("ours")[1:4] == ["6", "6", "100.0%"]
    assert page.row("ours")[4].startswith("54.1% to 100.0%")
    assert page.data["study-cases"]["drawn"] is True


def test_refusals_of_one_cause_are_one_row_with_a_count_and_plans_have_their_figure(
    grid: Campaign,
) -> None:
    found = worst_cases(grouped(grid.rows, "method"))
    refused = [(one.why, one.figure) for one in found if one.why.startswith("refused")]
    assert len(refused) == len(set(refused))
    for method in ("ours", "line"):
        mine = [row for row in grid.rows if row["method"] == method]
        counts = [
            one.figure for one in found if one.row["method"] == method and not one.row["solved"]
        ]
        causes = {row["status"] for row in mine if not row["solved"]}
        assert len(counts) == len(causes)
        assert sum(int(one.split()[0]) for one in counts) == sum(not row["solved"] for row in mine)
    paths = [
        one for one in found if one.why == "longest joint path" and one.row["method"] == "ours"
    ]
    longest = max(
        row["joint_path_length"] for row in grid.rows if row["method"] == "ours" and row["solved"]
    )
    assert paths[0].figure == f"{longest:.4f} rad"


def test_of_a_grid_the_first_map_is_a_plane_through_the_middle(told: dict[str, Any]) -> None:
    chosen = told["chosen"]
    names = [told["quantities"][int(chosen[which])]["name"] for which in ("across", "up")]
    assert names == [f"|{SPIN}| [rad/s]", f"{DURATION} [s]"]
    assert chosen["others"] == {f"{TURN} [deg]": 5.0}


def test_a_case_has_a_page_of_its_plan_that_the_report_links(grid: Campaign) -> None:
    worst = worst_cases(grouped(grid.rows, "method"))
    solved = next(one.row for one in worst if one.row["solved"])
    id_ = solved["id"]
    assert main(["campaign", "report", str(grid.directory), "--case", id_]) == 0
    page = Page((grid.directory / "cases" / id_ / "plan.html").read_text(encoding="utf-8"))
    assert page.words.strip().startswith(f"case {id_} of out: report of ff-planner")
    assert "Solved." in page.words
    assert "it came out otherwise" not in page.words
    assert page.row(id_)[7] == f"{solved['joint_path_length']:.4f}"
    assert "plan-0-scene" in page.plots
    # It runs its own script, and loads one file: plotly, beside the tables.
    assert page.referred == ["../../plotly.js", "#plan-0"]
    assert page.policy.startswith("default-src 'none'; script-src 'self' 'sha256-")
    assert (grid.directory / "plotly.js").stat().st_size > 1e6
    report = grid.page("--plans", "0")
    assert f"cases/{id_}/plan.html" in report.referred
    assert report.data["study-cases"]["pages"][id_] == f"cases/{id_}/plan.html"


def test_a_case_that_was_refused_at_once_is_drawn_as_it_was_asked(tmp_path: Path) -> None:
    grid = {"target.position[0]": {"plus": [90.0]}}
    methods = [{"name": "ours"}]
    far = Campaign(study(tmp_path, variations={"grid": grid}, methods=methods), tmp_path / "out")
    (row,) = far.rows
    assert main(["campaign", "report", str(far.directory), "--case", row["id"]]) == 0
    page = Page((far.directory / "cases" / row["id"] / "plan.html").read_text(encoding="utf-8"))
    assert row["status"].upper() in page.words
    assert "asked-0" in page.plots


@pytest.mark.parametrize("method", METHODS)
def test_the_command_of_a_case_gives_its_answer_again(method: str, tmp_path: Path) -> None:
    """With the campaign's parameters, too: a plan has the same metrics, a refusal the same text."""
    (tmp_path / "parameters.yaml").write_text(
        "ff_planner: {ros__parameters: {planner: {position_tolerance: 0.002}}}", encoding="utf-8"
    )
    asked = study(
        tmp_path,
        variations={"grid": {"objective.joint_path_length": [2.0]}},
        methods=[{"name": "ours", "method": method}],
        parameters="parameters.yaml",
    )
    campaign = Campaign(asked, tmp_path / "out")
    (row,) = campaign.rows
    scenario = scenario_again(row, campaign.directory)
    program, *command = shlex.split(command_again(row, campaign.directory, scenario))
    assert program == "ff-planner"
    answer = tmp_path / "answer.json"
    assert main([*command, "--json", str(answer)]) == (0 if row["solved"] else 3)
    told = json.loads(answer.read_text(encoding="utf-8"))
    assert told["digest"] == row["digest"]
    if row["solved"]:
        assert told["metrics"]["joint_path_length"] == row["joint_path_length"]
        assert told["solver"]["stop_reason"] == row["message"]
    else:
        assert told["message"] == row["message"]


def test_a_method_without_a_known_name_is_no_planner(lemur_capture: PlanningProblem) -> None:
    with pytest.raises(KeyError, match="thorough"):
        method_of("thorough", PlanningTask(lemur_capture, load_parameters().planner))


def test_a_page_says_where_its_plan_is_another_than_the_tables(grid: Campaign) -> None:
    row = next(row for row in grid.rows if row["solved"]) | {"motion_digest": "0" * 16}
    assert save_case(row, grid.directory) == ""
    page = (grid.directory / "cases" / row["id"] / "plan.html").read_text(encoding="utf-8")
    assert "it came out otherwise than in the table" in page


@pytest.mark.parametrize(
    "change",
    [{"robot": {"urdf": "/etc/passwd"}}, {"obstacles": [{"shape": {"mesh": {"file": "x"}}}]}],
)
def test_a_scenario_of_a_campaign_names_no_file(change: dict[str, Any], tmp_path: Path) -> None:
    methods = [{"name": "ours"}]
    asked = study(tmp_path, variations={"grid": {DURATION: [2.0]}}, methods=methods)
    made = Campaign(asked, tmp_path / "out")
    kept = made.directory / "scenarios" / "quick_capture" / "scenario.yaml"
    document = json.loads(json.dumps(asked.sources[0].document)) | change
    kept.write_text(json.dumps(document), encoding="utf-8")
    assert main(["campaign", "report", str(made.directory), "--case", made.rows[0]["id"]]) == 2
    assert not list(made.directory.glob("cases/*/*"))


@pytest.mark.parametrize("case", ["nothing", "../../outside", ""])
def test_a_case_that_is_none_is_refused(
    case: str, grid: Campaign, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", "report", str(grid.directory), "--case", case]) == 2
    assert "--case is" in capsys.readouterr().err


@pytest.mark.nightly
def test_a_campaign_of_a_grid_is_a_map_with_a_page_for_each_point(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = CONFIG / "scenarios" / "planar_capture.yaml"
    grid = {"duration": {"range": [8, 12, 2]}, "target.position[0]": {"range": [1.3, 1.9, 2]}}
    study = {"scenarios": [str(scenario)], "variations": {"grid": grid}}
    (tmp_path / "map.yaml").write_text(json.dumps(study), encoding="utf-8")
    words = ["campaign", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "map")]
    assert main([*words, "--workers", "1"]) == 0
    assert main(["campaign", "report", str(tmp_path / "map")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "map" / "report.html")
    page = Page((tmp_path / "map" / "report.html").read_text(encoding="utf-8"))
    told = page.data["study-cases"]
    assert column(told, "duration [s]") == [8.0, 8.0, 12.0, 12.0]
    assert column(told, "target.position[0] [m]") == [1.3, 1.9, 1.3, 1.9]
    assert told["solved"].count(False) in (1, 2, 3)
    assert set(told["pages"]) == set(told["ids"])


@pytest.mark.parametrize(
    ("share", "digits", "shown"),
    [
        (0.0, 0, "0%"),
        (1e-9, 0, "1%"),
        (0.125, 1, "12.5%"),
        (0.9966, 0, "99%"),
        (9999 / 10_000, 1, "99.9%"),
        (1.0 - 1e-12, 2, "99.99%"),
        (1.0, 1, "100.0%"),
    ],
)
def test_only_all_is_100_percent_and_only_none_is_0(share: float, digits: int, shown: str) -> None:
    assert percent(share, digits) == shown


def test_a_method_that_misses_one_case_of_many_does_not_solve_all() -> None:
    rows = [
        {"solved": k > 0, "status": "no_plan", "min_clearance": None, "solve_time": None}
        for k in range(1000)
    ]
    assert "999 of 1000 cases are solved (99%)" in _verdict(Group("optimal", rows))
