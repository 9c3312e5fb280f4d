"""The report page of a campaign: results, plots over the varied quantities, worst cases."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote
from xml.etree.ElementTree import Element

import numpy as np

from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.campaign.run import CASES, VERSIONS
from ff_planner_ros.campaign.table import below, digest_of, read_plans, read_versions
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.report.fleet import on_all_cores
from ff_planner_ros.report.html import (
    LIBRARY,
    bullets,
    element,
    pairs,
    row,
    save_html,
    save_library,
    table,
)
from ff_planner_ros.report.statistics import Group, Rate, Row, grouped
from ff_planner_ros.report.study.case import PAGE, save_case
from ff_planner_ros.report.study.columns import metrics
from ff_planner_ros.report.study.explorer import code_of, explorer
from ff_planner_ros.report.study.worst import WorstCase, worst_cases, worst_section

# Rows of a table of sources: more of them are counted together, and those with the most refusals
# are shown.
_MOST_SOURCES = 40
# So many pages or more are drawn by one process a core.
_FOR_PROCESSES = 6
# Statuses below are refusals of the task itself, above of a method, and defects of the planner.
_NO_PLAN, _DEFECT = 300, 400
_MOST_TOLD = 3  # causes, in a sentence
_QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)


def save_campaign_page(
    directory: Path, file: Path | None, most_plans: int
) -> tuple[Path, list[str]]:
    """Write the report of a campaign's directory.

    Args:
        directory: Directory of the campaign.
        file: The page; None: `report.html` in the directory.
        most_plans: Largest number of cases with a page of their own: all cases, if they are no
            more, or else the worst.

    Returns:
        The path of the page, and notes on cases whose page failed.

    Raises:
        InvalidInput: There is no campaign, or a file of it is damaged.
        OSError: The page cannot be written.
    """
    plans = read_plans(directory)
    rows = plans.sort_by("number").to_pylist()
    file = below(directory, "report.html") if file is None else file
    title, worst = directory.resolve().name, worst_cases(grouped(rows, "method"))
    chosen = list({one.row["id"]: one.row for one in worst}.values())
    if len(rows) <= most_plans:
        chosen = rows
    notes = _save_pages(chosen[:most_plans], directory)
    pages = {
        page.parent.name: quote(os.path.relpath(page.resolve(), file.resolve().parent))
        for page in (directory / CASES).glob(f"*/{PAGE}")
        if page.parent.name not in notes
    }
    save_html(title, _sections(title, directory, rows, digest_of(plans), worst, pages), file)
    return file, [f"{case} has no page: {why}" for case, why in notes.items()]


def save_case_page(directory: Path, case: str) -> Path:
    """Write the page of one case of a campaign, and return its path.

    Raises:
        InvalidInput: There is no campaign, no such case, or its page cannot be made or written.
        OSError: The file of plotly.js cannot be written.
    """
    rows = {one["id"]: one for one in read_plans(directory).to_pylist()}
    if case not in rows:
        allowed = f"it must be the id of one of the {len(rows)} cases"
        raise InvalidInput(Status.OUT_OF_RANGE, "--case", case, allowed)
    if notes := _save_pages([rows[case]], directory):
        raise InvalidInput(Status.UNSUPPORTED, "--case", case, notes[case])
    return below(directory, CASES, case, PAGE)


def _save_pages(chosen: Sequence[Row], directory: Path) -> dict[str, str]:
    """Write the pages of some cases; return the reasons of failure by case id."""
    if not chosen:
        return {}
    save_library(below(directory, LIBRARY))
    notes = dict[str, str]()
    with progress_bar("drawing plans", len(chosen), unit="plans", per_unit=1) as advance:
        wrong = on_all_cores(
            save_case, len(chosen) >= _FOR_PROCESSES, chosen, [directory] * len(chosen)
        )
        for one, error in zip(chosen, wrong, strict=True):
            if error:
                notes[one["id"]] = error
            advance(1)
    return notes


def _sections(
    title: str,
    directory: Path,
    rows: Sequence[Row],
    digest: str,
    worst: Sequence[WorstCase],
    pages: Mapping[str, str],
) -> Iterator[Element]:
    methods = grouped(rows, "method")
    yield element("h1", f"Campaign: {title}")
    for group in methods:
        yield element("p", _verdict(group), {"class": "verdict"})
    if any(row["status"] == "internal_error" for row in rows):
        words = (
            "Some cases ended with an internal error, a defect of the planner: please report it."
        )
        yield bullets([words], "notes")
    yield _table("method", methods)
    yield element("h2", "Pictures")
    yield from explorer(directory, rows, pages)
    yield from _by_source(rows)
    yield from _refusals(methods)
    yield from _metrics(methods)
    yield from worst_section(directory, worst, pages)
    yield element("h2", "About this campaign")
    yield pairs(_facts(directory, rows, methods, digest))


def _verdict(group: Group) -> str:
    """Return the results of a method in a sentence."""
    solved = group.solved
    share = percent(solved.share, 0)
    words = f"{group.name}: {solved.count} of {solved.total} cases are solved ({share})"
    if causes := group.causes.most_common(_MOST_TOLD):
        words += f"; refused: {', '.join(f'{count} {cause}' for cause, count in causes)}"
        words += " and others" if len(group.causes) > _MOST_TOLD else ""
    values = group.values("min_clearance")
    if len(values):
        words += f"; no plan comes nearer to an obstacle than {1e3 * values.min():.2g} mm"
    return f"{words}."


def _facts(
    directory: Path, rows: Sequence[Row], methods: Sequence[Group], digest: str
) -> Iterator[tuple[str, str]]:
    yield "directory", str(directory)
    yield "methods", ", ".join(one.name for one in methods)
    yield "scenarios", str(len({row["source"] for row in rows}))
    yield "results", f"{digest}, a hash of every number but the times"
    times = [row["solve_time"] for row in rows if row["solve_time"] is not None]
    yield "planned for", f"{sum(times) / 3600:.2f} hours of one core"
    versions = read_versions(below(directory, VERSIONS))
    yield "made by", ", ".join(f"{k} {v}" for k, v in versions.items()) or "not known"


def _table(what: str, groups: Sequence[Group]) -> Element:
    """Return a table of success rates; cases drawn at random have an interval."""
    drawn = any(group.is_drawn for group in groups)
    columns = (what, "plans", "solved", "rate", *(("95 % interval",) if drawn else ()))
    return table(columns, [row(_cells(group, drawn)) for group in groups])


def _cells(group: Group, drawn: bool) -> Iterator[str]:
    low, high = group.solved.interval
    yield group.name
    yield str(group.solved.total)
    yield str(group.solved.count)
    yield percent(group.solved.share)
    if drawn:
        yield f"{percent(low)} to {percent(high)}"


def _by_source(rows: Sequence[Row]) -> Iterator[Element]:
    groups = grouped(rows, "source", "method")
    if len({row["source"] for row in rows}) < 2:
        return
    yield element("h2", "Scenarios")
    if len(groups) > _MOST_SOURCES:
        words = f"Of {len(groups)} scenarios with a method each, those with the most refusals."
        yield element("p", words)
        groups.sort(key=lambda one: one.solved.count - one.solved.total)
    yield _table("scenario, method", groups[:_MOST_SOURCES])


def _refusals(methods: Sequence[Group]) -> Iterator[Element]:
    causes = sorted({cause for group in methods for cause in group.causes}, key=code_of)
    if not causes:
        return
    yield element("h2", "Causes of refusal")
    cells = (
        [str(code_of(c)), c, *(str(group.causes[c]) for group in methods), _class(c)]
        for c in causes
    )
    columns = ("code", "cause", *(group.name for group in methods), "whose")
    yield table(columns, [row(one) for one in cells])
    for group in methods:
        impossible = sum(n for cause, n in group.causes.items() if code_of(cause) < _NO_PLAN)
        if 0 < impossible < group.solved.total:
            rest = Rate(group.solved.count, group.solved.total - impossible)
            low, high = rest.interval
            sure = f" ({percent(low)} to {percent(high)})" if group.is_drawn else ""
            words = (
                f"{group.name}: of the {rest.total} cases whose task is possible so far as is "
                f"known at the start, {rest.count} are solved: {percent(rest.share)}{sure}."
            )
            yield element("p", words)


def _class(cause: str) -> str:
    if code_of(cause) < _NO_PLAN:
        return "the task itself: no method may start from it"
    return "no plan was found" if code_of(cause) < _DEFECT else "a defect of the planner"


def _metrics(methods: Sequence[Group]) -> Iterator[Element]:
    """Yield the table of every metric."""
    yield element("h2", "Metrics")
    words = "Of solved plans; times are of one plan on one core, whether solved or refused."
    yield element("p", words)
    made, of_each = list[Element](), {group.name: metrics(group.rows) for group in methods}
    labels = dict.fromkeys(one.name for found in of_each.values() for one in found)
    for label in labels:  # methods below each other
        for method, found in of_each.items():
            for values in (one.known for one in found if one.name == label):
                shares = (f"{value:.4g}" for value in np.quantile(values, _QUANTILES))
                made.append(row((label, method, str(len(values)), *shares)))
    names = ("least", "5 %", "median", "95 %", "most")
    yield table(("metric", "method", "plans", *names), made)
