"""Many bags at once: each answer counts once, copies too; a broken bag costs no other."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from answers import exchange, write_bag
from ff_planner_msgs.msg import PlanRequest
from scipy.stats import binom

from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.errors import BagError, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.report import fleet_page
from ff_planner_ros.report.fleet import MEASURED, PERCENTILES, bags_below, read_fleet
from ff_planner_ros.runs.offline_bag import record_answer

NODE = Path(__file__).parent / "golden_bags" / "node"
# Copies of each bag, which count once, and one more below.
COPIES = {"offline": 3, "node": 2, "refused": 2}
BROKEN = ("a_empty", "b_zero", "c_noise")


@pytest.fixture(scope="module")
def bags(
    offline_bag: Path, lemur_capture: PlanningProblem, tmp_path_factory: pytest.TempPathFactory
) -> Mapping[str, Path]:
    """A bag with a plan, one with a refusal, and one of a node, by name."""
    refused = tmp_path_factory.mktemp("bags") / "refused"
    error = NoPlanFound(Status.GOAL_OUT_OF_REACH, "too far")
    record_answer(refused, PlanningTask(lemur_capture, load_parameters().planner), error, 0.1)
    return {"offline": offline_bag, "node": NODE, "refused": refused}


@pytest.fixture(scope="module")
def fleet(bags: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory of bags, three of which nothing can be read, copies, and what is no bag."""
    directory = tmp_path_factory.mktemp("fleet") / "runs"
    for name, copies in COPIES.items():
        for number in range(copies):
            shutil.copytree(bags[name], directory / f"{name}_{number}")
    shutil.copytree(bags["offline"], directory / "day" / "two" / "late")
    for name, content in zip(BROKEN, (None, b"", b"no MCAP" * 99), strict=True):
        (directory / name).mkdir()
        if content is not None:
            (directory / name / "x.mcap").write_bytes(content)
    (directory / "a_empty" / "metadata.yaml").touch()
    (directory / "notes").mkdir()
    (directory / "notes" / "log.txt").write_text("no bag")
    return directory


def answers(bags: Mapping[str, Path]) -> Counter[str]:
    """By status, how many answers the bags of the fleet hold, counted bag by bag."""
    return Counter(plan.status for bag in bags.values() for plan in read_plans(bag))


@pytest.mark.filterwarnings("ignore")
def test_every_answer_of_every_bag_is_counted_once(
    fleet: Path, bags: Mapping[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(fleet), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    expected = answers(bags)
    assert told["requests_by_status"] == dict(expected)
    assert told["solved_count"] == expected["SOLVED"]
    assert set(told["skipped"]) == set(BROKEN)
    # Of copies the first by name counts.
    assert told["bags"] == ["day/two/late", "node_0", "refused_0"]
    assert told["copies"] == {
        **{f"offline_{k}": "day/two/late" for k in range(3)},
        "node_1": "node_0",
        "refused_1": "refused_0",
    }
    # At an end of the interval what was seen, or more of its kind, is as rare as 2.5 %.
    count, total = expected["SOLVED"], expected.total()
    low, high = told["success_interval"]
    assert binom.sf(count - 1, total, low) == pytest.approx(0.025)
    assert binom.cdf(count, total, high) == pytest.approx(0.025)
    clearances = [
        plan.metrics["min_clearance"]
        for bag in bags.values()
        for plan in read_plans(bag)
        if plan.status == "SOLVED"
    ]
    expected_percentiles = np.percentile(clearances, PERCENTILES)
    found = list(told["percentiles"]["min_clearance_m"].values())
    assert found == pytest.approx(expected_percentiles)


@pytest.mark.filterwarnings("ignore")
def test_lines_and_table_tell_the_same(
    fleet: Path, bags: Mapping[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(fleet)]) == 0
    lines = capsys.readouterr().out
    for name in BROKEN:
        assert f"skipped: {name}: " in lines
    assert "copy: node_1 is a copy of node_0, and counts once" in lines
    file = tmp_path / "answers.parquet"
    assert main(["export", str(fleet), "--parquet", str(file)]) == 0
    rows = pyarrow.parquet.read_table(file).to_pylist()
    assert Counter(row["status"] for row in rows) == answers(bags)
    assert {row["bag"] for row in rows if row["status"] == "SOLVED"} >= {"day/two/late"}
    assert all(row["min_clearance_m"] > 0.0 for row in rows if row["solved"])
    assert {*MEASURED} <= rows[0].keys()
    assert main(["export", str(fleet), "--parquet", str(file)]) == 2
    assert "is not overwritten" in capsys.readouterr().err


def test_a_table_of_one_bag_has_its_answers(offline_bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "one.parquet"
    assert main(["export", str(offline_bag), "--parquet", str(file)]) == 0
    row, *others = pyarrow.parquet.read_table(file).to_pylist()
    assert (row["bag"], row["status"], others) == ("offline", "SOLVED", [])


@pytest.mark.filterwarnings("ignore")
def test_the_page_has_the_worst_runs_first_with_links_to_their_pages(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_page, "PAGES", 2)
    page = tmp_path / "runs.html"
    assert main(["report", str(fleet), "--output", str(page), "--plans", "1"]) == 0
    text = page.read_text(encoding="utf-8")
    links = re.findall(r'<a href="([^"]*)">([^<]*)</a>', text)
    assert [name for _, name in links] == ["refused_0", "node_0"]
    for link, name in links:
        assert name in (tmp_path / link).read_text(encoding="utf-8")
    places = [text.index(f">{run.name}<") for run in read_fleet(fleet).runs]
    assert places == sorted(places)
    for name in BROKEN:
        assert f"skipped: {name}" in text


def killed(directory: Path, at_ns: int) -> None:
    """Record a request whose answer never came."""
    write_bag(directory, exchange(request=PlanRequest(), ns=at_ns), start_ns=at_ns)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("others", [(), ("offline",)])
def test_runs_that_were_killed_before_their_first_answer_count_each(
    others: tuple[str, ...], offline_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    for number, name in enumerate(("a_first", "b_second"), 1):
        killed(runs / name, number)
    shutil.copytree(runs / "b_second", runs / "c_copy")
    for name in others:
        shutil.copytree(offline_bag, runs / name)
    assert main(["info", str(runs)]) == 0
    assert main(["report", str(runs), "--output", str(tmp_path / "page.html")]) == 0
    capsys.readouterr()
    assert main(["info", str(runs), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["requests_by_status"] == {"no answer": 2} | dict.fromkeys(
        ("SOLVED",) * len(others), 1
    )
    assert told["copies"] == {"c_copy": "b_second"}


@pytest.mark.filterwarnings("ignore")
def test_bags_whose_names_look_the_same_are_two_and_each_has_its_page(tmp_path: Path) -> None:
    for number, name in enumerate(("run\n", "run\t"), 1):
        killed(tmp_path / "runs" / name, number)
    fleet = read_fleet(tmp_path / "runs")
    assert list(fleet.read) == ["run?", "run? (2)"]
    assert [run.name for run in fleet.runs] == ["run?", "run? (2)"]
    assert fleet_page.save_fleet_page(fleet, tmp_path / "page", 1) == []
    assert len(list((tmp_path / "page_runs").iterdir())) == 2


@pytest.mark.filterwarnings("ignore")
def test_reports_of_run_1_and_run_2_are_two_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("run.1", "run.2"):
        killed(tmp_path / name, 1)
        assert main(["report", name]) == 0
    assert {page.name for page in tmp_path.glob("*.html")} == {
        "run.1_report.html",
        "run.2_report.html",
    }


def test_a_bag_itself_is_no_fleet_and_broken_ones_alone_are_an_error(
    fleet: Path, tmp_path: Path
) -> None:
    assert bags_below(NODE) == []
    assert bags_below(tmp_path) == []
    shutil.copytree(fleet / "b_zero", tmp_path / "one")
    with pytest.raises(BagError, match=r"of the 1 bags in .* none can be read; the first: .*empty"):
        read_fleet(tmp_path)
