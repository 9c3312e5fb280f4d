"""The report of many bags: one page, with links to pages of the worst runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote
from xml.etree.ElementTree import Element

from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.report.fleet import (
    FIGURES,
    MEASURED,
    PERCENTILES,
    Fleet,
    on_all_cores,
    publication_counts,
    success_words,
)
from ff_planner_ros.report.html import NOTHING, bullets, element, pairs, plot, row, save_html, table
from ff_planner_ros.report.statistics import Group
from ff_planner_ros.report.statistics_plots import time_plot

# Runs that get a page of their own: each is some megabytes.
PAGES = 10
# So many pages or more are drawn by one process a core: to start one takes as long as a page.
_FOR_PROCESSES = 4
_COLUMNS = (
    *("run", "requests", "solved", "causes", "slowest [s]", "least clearance [mm]"),
    *("joints off [rad]", "chaser off [mm]", "end effector off [mm]"),
)
_OF_RUNS = (
    ("solve_time_s", 1.0, max),
    ("min_clearance_m", 1e3, min),
    (MEASURED[0], 1.0, max),
    (MEASURED[1], 1e3, max),
    (MEASURED[2], 1e3, max),
)


def save_fleet_page(fleet: Fleet, file: Path, most_plans: int) -> list[str]:
    """Write the page of many bags, and pages of the worst runs; return notes on missing pages.

    Args:
        most_plans: Largest number of plans drawn of a run, its last ones.

    Raises:
        OSError: A page cannot be written.
    """
    pages: dict[str, Path] = {}
    notes: list[str] = []
    directory = file.with_name(file.stem if file.suffix == ".html" else f"{file.name}_runs")
    directory.mkdir(exist_ok=True)
    worst = fleet.runs[:PAGES]
    bags = [fleet.read[run.name] for run in worst]
    files = [directory / f"{n:02d}_{bag.name}.html" for n, bag in enumerate(bags, start=1)]
    pays = len(worst) >= _FOR_PROCESSES
    with progress_bar("drawing runs", len(worst), unit="runs", per_unit=1) as advance:
        wrong = on_all_cores(_save_page_of, pays, bags, files, [most_plans] * len(worst))
        for run, page, error in zip(worst, files, wrong, strict=True):
            if error:
                notes.append(f"{run.name}: {error}")
            else:
                pages[run.name] = page.relative_to(file.parent)
            advance(1)
    title = fleet.directory.resolve().name
    save_html(title, _sections(title, fleet, pages), file)
    return notes


def _save_page_of(bag: Path, page: Path, most_plans: int) -> str:
    """Write the page of a bag; return an error message, or nothing."""
    from ff_planner_ros.report.from_bag import report_of_bag
    from ff_planner_ros.report.run_page import save_page

    try:
        save_page(report_of_bag(bag, most_plans), page)
    except FfPlannerError as error:
        return str(error)
    return ""


def _sections(title: str, fleet: Fleet, pages: dict[str, Path]) -> Iterator[Element]:
    yield element("h1", f"Runs: {title}")
    yield pairs(
        [
            ("directory", str(fleet.directory)),
            (
                "bags",
                f"{len(fleet.read)} read, {len(fleet.skipped)} skipped, {len(fleet.copies)} copies",
            ),
            ("requests", f"{len(fleet.rows)}{success_words(fleet)}"),
        ]
    )
    if fleet.skipped:
        yield bullets([f"skipped: {name}: {why}" for name, why in fleet.skipped], "notes")
    if fleet.copies:
        copies = [f"{name} is a copy of {first}, and counts once" for name, first in fleet.copies]
        yield bullets(copies, "notes")
    if fleet.causes:
        yield element("h2", "Causes of refusal")
        yield table(
            ("status", "requests"), [row((k, str(n))) for k, n in fleet.causes.most_common()]
        )
    if counts := publication_counts(fleet):
        yield element("h2", "publish_plan")
        yield table(("status", "requests"), [row((k, str(n))) for k, n in counts])
    yield element("h2", "Times, clearance, planned against measured")
    yield _percentiles(fleet)
    timed = [{**one, "solve_time": one.get("solve_time_s")} for one in fleet.rows]
    if any(one["solve_time"] is not None for one in timed):
        caption = "Share of the requests that are answered, solved or refused, within a time."
        yield plot("times", time_plot([Group("all", timed)]), caption)
    yield element("h2", "Runs, the worst first")
    words = (
        "First those with refusals, by their share; then those whose end effector was furthest "
        "off its plan; then those that came nearest to something. The first have a page."
    )
    yield element("p", words)
    yield table(_COLUMNS, [row(_cells(run, pages)) for run in fleet.runs])
    if fleet.notes:
        yield element("h2", "Notes")
        yield bullets(fleet.notes, "notes")


def _percentiles(fleet: Fleet) -> Element:
    rows = []
    for words, column, factor in FIGURES:
        found = fleet.percentiles(column)
        cells = (
            [NOTHING] * len(PERCENTILES)
            if found is None
            else [f"{factor * value:.4g}" for value in found]
        )
        rows.append(row((words, *cells)))
    return table(("", "least", *(f"{share} %" for share in PERCENTILES[1:-1]), "most"), rows)


def _cells(run: Group, pages: dict[str, Path]) -> Iterator[Element | str]:
    page = pages.get(run.name)
    yield run.name if page is None else element("a", run.name, href=quote(page.as_posix()))
    yield str(run.solved.total)
    yield str(run.solved.count)
    yield ", ".join(f"{count} {status}" for status, count in run.causes.most_common()) or NOTHING
    for column, factor, worst in _OF_RUNS:
        values = run.values(column, solved_only=column != "solve_time_s")
        yield f"{factor * float(worst(values)):.4g}" if len(values) else NOTHING
