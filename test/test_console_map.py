"""The map of a study in the console: its cells are the cases of the table, a click shows one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import viser
from campaigns import study
from chromium import NEEDS_CHROMIUM, OF_CONTRAST
from test_console_colours import contrast

from ff_planner_ros.campaign.run import run_campaign
from ff_planner_ros.campaign.table import read_plans
from ff_planner_ros.commands.campaigns import is_campaign
from ff_planner_ros.console.colours import CAUSES, TEXT
from ff_planner_ros.console.serve import Served, serve
from ff_planner_ros.console.study.cells import axis_of, plane
from ff_planner_ros.console.study.open import StudyPage
from ff_planner_ros.console.study.panel import StudyPanel
from ff_planner_ros.console.study.picture import Case, heat_map
from ff_planner_ros.report.study.columns import Column

WAIT = 300_000  # [ms]
WORDS = {"collision": "301 COLLISION", "no_plan_found": "399 NO_PLAN_FOUND"}


def column(name: str, *values: float | None) -> Column:
    return Column(name, name, values)


def test_few_values_have_a_cell_each_and_many_lie_in_equal_parts() -> None:
    few = axis_of(column("x", 3.0, 1.0, None, 3.0), range(4))
    assert few.words == ("1", "3")
    assert few.places == (1, 0, None, 1)
    values = [0.1 * k for k in range(101)]
    many = axis_of(column("x", *values), range(101))
    assert many.words[0] == "0 to 2"
    assert many.places[0] == 0
    assert many.places[-1] == len(many.words) - 1 == 4
    counts = [many.places.count(k) for k in range(5)]
    assert max(counts) - min(counts) <= 1


def test_a_cell_holds_the_cases_at_its_place() -> None:
    found = plane(column("x", 1.0, 1.0, 2.0, None), column("y", 5.0, 5.0, 5.0, 6.0), range(4))
    assert found.cells == {(0, 0): (0, 1), (1, 0): (2,)}


def drawn(chosen: str) -> str:
    over = plane(column("x", 1.0, 1.0, 2.0), column("y", 5.0, 5.0, 5.0), range(3))
    cases = [
        Case("case 1", 2.0, None),
        Case("case 2", 4.0, None),
        Case("case <3>", None, "collision"),
    ]
    return heat_map(over, cases, "joint path [rad]", WORDS, chosen)


def test_a_map_tells_median_and_refusal_and_clicks_go_through_a_cell() -> None:
    shown = drawn(chosen="")
    assert "x: 1, y: 5, 2 cases, 2 solved, joint path [rad]: 3" in shown
    assert "refused: 301 COLLISION" in shown
    assert "NO_PLAN_FOUND" not in shown  # no cell is refused by that
    assert "data-name='case 1'" in shown
    assert "data-name='case &lt;3&gt;'" in shown
    assert "data-name='case 2'" in drawn(chosen="case 1")
    assert "data-name='case 1'" in drawn(chosen="case 2")


@pytest.mark.parametrize("cause", CAUSES)
def test_words_in_a_refused_cell_can_be_read(cause: tuple[int, int, int]) -> None:
    assert contrast(TEXT, f"#{bytes(cause).hex()}") >= 4.5


def test_a_map_of_cases_that_are_all_refused_unplanned_shows_their_causes() -> None:
    """As where the start of every case is in collision: no case has a time or a metric."""
    rows = {
        f"case {k}": {
            "solved": False,
            "status": "collision",
            "solve_time": None,
            "message": "touching",
            "method": "ours",
            "source": "s",
            "change.x": float(k % 2),
            "change.y": float(k > 1),
        }
        for k in range(4)
    }
    server = viser.ViserServer(port=8950, verbose=False)
    try:
        panel = StudyPanel(server, rows)
        panel.show("case 3")
        assert panel._picture.content.count("refused: 301 COLLISION") == 2 * len(rows)
    finally:
        server.stop()


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two durations, a goal in reach and one far beyond."""
    directory = tmp_path_factory.mktemp("map")
    grid = {"duration": [2.0, 2.5], "target.position[0]": {"plus": [0.0, 50.0]}}
    asked = study(directory, variations={"grid": grid}, methods=[{"name": "ours"}])
    run_campaign(asked, directory / "map", workers=1)
    return directory / "map"


@pytest.fixture
def served(mapped: Path) -> Iterator[Served]:
    served = serve(StudyPage(mapped).page_on, "127.0.0.1", 8900)
    yield served
    while served.page.search is not None:
        served.page.search.wait()
    with served.page._lock:
        served.server.stop()


@pytest.mark.ci
def test_a_directory_with_a_table_is_a_campaign(mapped: Path, tmp_path: Path) -> None:
    assert is_campaign(mapped)
    assert not is_campaign(tmp_path)


@pytest.mark.ci
@NEEDS_CHROMIUM
def test_a_click_on_a_cell_shows_its_plan_or_its_refusal(
    served: Served, browser: Any, mapped: Path
) -> None:
    page, errors = browser.new_page(viewport={"width": 1300, "height": 800}), list[str]()
    page.set_default_timeout(WAIT)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda said: said.type == "error" and errors.append(said.text))
    page.goto(served.address)
    rows = read_plans(mapped).sort_by("number").to_pylist()
    cells = page.locator("rect[data-name]")
    cells.last.wait_for()
    assert cells.count() == len(rows) == 4
    first = next(k for k, row in enumerate(rows, start=1) if row["solved"])
    page.get_by_text(re.compile(f"case {first}: planned")).first.wait_for()
    other = page.locator("rect[aria-label*='2.5'][aria-label*='solved']")
    name = other.get_attribute("data-name")
    row = rows[int(name.split()[1]) - 1]
    other.click()
    page.get_by_text(re.compile(f"{name}: planned")).first.wait_for()
    plan = served.page.chosen.plan
    assert plan is not None
    assert plan.duration == pytest.approx(2.5)
    assert plan.metrics.joint_path_length == row["joint_path_length"]
    refused = page.locator("rect[aria-label*='duration [s]: 2,'][aria-label*='refused']")
    name = refused.get_attribute("data-name")
    row = rows[int(name.split()[1]) - 1]
    refused.focus()
    page.keyboard.press("Enter")
    page.get_by_text(f"{name}: refused, {row['status'].upper()}").first.wait_for()
    page.get_by_text(row["message"]).first.wait_for()
    assert page.evaluate(OF_CONTRAST) == []
    assert errors == []
    page.close()
