"""A study's pictures in a real Chromium: what they show is what the table says."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from ff_planner_ros.common.intervals import exact_interval
from ff_planner_ros.report.html import save_html
from ff_planner_ros.report.study.explorer import explorer

playwright = pytest.importorskip(
    "playwright.sync_api", reason="no playwright: pip install playwright"
)
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.ci,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
]
WAIT = 60_000  # [ms]
EVIL = "<img src=x onerror='document.title=1'>"
# Two values of one quantity, three of another: 40 cases each, but for a cell where none is solved.
LEVELS = [(x, y) for x in (1.0, 2.0) for y in (10.0, 20.0, 30.0)]


def rows(drawn: bool) -> list[dict[str, Any]]:
    rng, made = np.random.default_rng(5), list[dict[str, Any]]()
    for x, y in LEVELS:
        for _ in range(40 if drawn else 1):
            solved = bool(rng.random() < 0.7) and (x, y) != (2.0, 30.0)
            made.append(
                {
                    "id": f"{len(made):016x}",
                    "number": len(made),
                    "method": EVIL,
                    "source": "scenario",
                    "status": "solved" if solved else "collision",
                    "solved": solved,
                    "drawn": drawn,
                    "solve_time": 0.1,
                    "joint_path_length": float(rng.uniform(1.0, 3.0)) if solved else None,
                    "change.duration": x,
                    "change.points": y,
                }
            )
    return made


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


def opened(browser: Any, directory: Path, told: list[dict[str, Any]], pages: dict[str, str]) -> Any:
    save_html("study", explorer(directory, told, pages), directory / "report.html")
    page = browser.new_page(viewport={"width": 1300, "height": 950})
    page.on("pageerror", lambda error: pytest.fail(str(error)))
    page.goto((directory / "report.html").as_uri())
    page.wait_for_selector(".right .nsewdrag", timeout=WAIT)
    return page


def drawn(page: Any, where: str) -> list[dict[str, Any]]:
    """The traces of a picture."""
    found = page.evaluate(
        f"document.querySelector('.{where}').data.map((trace) => "
        "({...trace, x: [...trace.x], y: [...trace.y]}))"
    )
    return list(found)


def test_maps_curves_and_intervals_are_those_of_the_table(browser: Any, tmp_path: Path) -> None:
    told = rows(drawn=True)
    page = opened(browser, tmp_path, told, {})
    cells = {
        level: [r for r in told if (r["change.duration"], r["change.points"]) == level]
        for level in LEVELS
    }
    (shares, *_), (medians, causes, *_) = drawn(page, "left"), drawn(page, "right")
    for column, x in enumerate((1.0, 2.0)):
        for row, y in enumerate((10.0, 20.0, 30.0)):
            cell = cells[x, y]
            paths = [r["joint_path_length"] for r in cell if r["solved"]]
            share = 100.0 * len(paths) / len(cell)
            assert shares["z"][row][column] == pytest.approx(share)
            if paths:
                assert medians["z"][row][column] == pytest.approx(np.median(paths), rel=1e-5)
            else:
                assert medians["z"][row][column] is None
                assert causes["text"][row][column] == 301
    (curve,) = drawn(page, "curve")
    assert curve["x"] == [1.0, 2.0]
    for k, x in enumerate((1.0, 2.0)):
        mine = [r["solved"] for r in told if r["change.duration"] == x]
        low, high = exact_interval(sum(mine), len(mine))
        assert low == pytest.approx(binomtest(sum(mine), len(mine)).proportion_ci(0.95).low)
        assert curve["y"][k] == pytest.approx(100.0 * sum(mine) / len(mine))
        assert curve["y"][k] - curve["error_y"]["arrayminus"][k] == pytest.approx(100.0 * low)
        assert curve["y"][k] + curve["error_y"]["array"][k] == pytest.approx(100.0 * high)
    # A filter leaves the cases of one value.
    page.locator(".filters select").first.select_option("1")
    assert drawn(page, "curve")[0]["x"] == [1.0]
    # The method's name is text, wherever it stands.
    assert page.evaluate("document.querySelectorAll('img').length") == 0
    assert page.title() == "study: report of ff-planner"


def test_a_click_opens_the_plan_of_a_cell_with_one_case(browser: Any, tmp_path: Path) -> None:
    told = rows(drawn=False)
    solved = next(row for row in told if row["solved"])
    (tmp_path / "plan.html").write_text("<title>the plan</title>", encoding="utf-8")
    page = opened(browser, tmp_path, told, {solved["id"]: "plan.html"})
    box = page.locator(".left .nsewdrag").bounding_box()
    column = (1.0, 2.0).index(solved["change.duration"])
    row = (10.0, 20.0, 30.0).index(solved["change.points"])
    with page.context.expect_page(timeout=WAIT) as plan:
        page.mouse.click(
            box["x"] + box["width"] * (column + 0.5) / 2,
            box["y"] + box["height"] * (1.0 - (row + 0.5) / 3),
        )
    plan.value.wait_for_load_state()
    assert plan.value.title() == "the plan"
    assert solved["id"] in page.locator(".cases").inner_text()
