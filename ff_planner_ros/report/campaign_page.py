"""The report of a campaign: tables and figures on one page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ff_planner_ros.campaign.again import changes_of, command_again
from ff_planner_ros.campaign.run import VERSIONS
from ff_planner_ros.campaign.table import below, digest_of, read_plans, read_versions
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.report.html import NOTHING, bullets, element, pairs, plot, row, save_html, table
from ff_planner_ros.report.statistics import Group, Rate, Row, grouped, worst
from ff_planner_ros.report.statistics_plots import rate_plot, time_plot, varied_plot

# Rows of a table of sources: more of them are counted together, and those with the most refusals
# are shown. Rows of each kind among the worst. Columns of what was varied that are drawn.
_MOST_SOURCES, _MOST_WORST, _MOST_VARIED = 40, 5, 20
_MOST_CURVES = 6  # in a figure: scenarios apart, or else together
# Statuses below are refusals of the task itself, above of a method, and defects of the planner.
_NO_PLAN, _DEFECT = 300, 400
_COLUMNS = (
    *("plans", "solved", "rate", "95 % interval"),
    *("time, median [s]", "95 % within [s]", "joint path, median [rad]", "attitude, median [deg]"),
    "least clearance [mm]",
)


def save_campaign_page(directory: Path, file: Path | None = None) -> Path:
    """Write the report of a campaign's directory, and return the path of the page.

    Raises:
        InvalidInput: There is no campaign, or a file of it is damaged.
        OSError: The page cannot be written.
    """
    plans = read_plans(directory)
    rows = plans.sort_by("number").to_pylist()
    file = below(directory, "report.html") if file is None else file
    title = directory.resolve().name
    sections = _sections(title, directory, rows, digest_of(plans))
    save_html(title, sections, file)
    return file


def _sections(title: str, directory: Path, rows: Sequence[Row], digest: str) -> Iterator[Element]:
    methods = grouped(rows, "method")
    yield element("h1", f"Campaign: {title}")
    yield pairs(_facts(directory, rows, methods, digest))
    if any(row["status"] == "internal_error" for row in rows):
        words = (
            "Some cases ended with an internal error, a defect of the planner: please report it."
        )
        yield bullets([words], "notes")
    yield element("h2", "Success")
    words = (
        "Times are of one plan on one core, whether solved or refused; all else of solved plans."
    )
    yield element("p", words)
    yield _table("method", methods)
    caption = "Share of cases that are solved, by method, with the exact 95 % confidence interval."
    yield plot("rates", rate_plot(methods), caption)
    yield from _by_source(rows)
    yield from _refusals(methods)
    yield element("h2", "Times")
    caption = "Share of all cases that are answered, solved or refused, within a time."
    yield plot("times", time_plot(methods), caption)
    yield from _varied(rows, methods)
    yield from _worst(directory, methods)


def _facts(
    directory: Path, rows: Sequence[Row], methods: Sequence[Group], digest: str
) -> Iterator[tuple[str, str]]:
    solved = Rate(sum(bool(row["solved"]) for row in rows), len(rows))
    yield "directory", str(directory)
    yield "plans", f"{len(rows)}: {solved.count} solved, {len(rows) - solved.count} refused"
    yield "methods", ", ".join(one.name for one in methods)
    yield "scenarios", str(len({row["source"] for row in rows}))
    yield "results", f"{digest}, a hash of every number but the times"
    times = [row["solve_time"] for row in rows if row["solve_time"] is not None]
    yield "planned for", f"{sum(times) / 3600:.2f} hours of one core"
    versions = read_versions(below(directory, VERSIONS))
    yield "made by", ", ".join(f"{k} {v}" for k, v in versions.items()) or "not known"


def _table(what: str, groups: Sequence[Group]) -> Element:
    return table((what, *_COLUMNS), [row(_cells(group)) for group in groups])


def _cells(group: Group) -> Iterator[str]:
    low, high = group.solved.interval
    yield group.name
    yield str(group.solved.total)
    yield str(group.solved.count)
    yield f"{group.solved.share:.1%}"
    yield f"{low:.1%} to {high:.1%}"
    times = group.values("solve_time", solved_only=False)
    for share in (0.5, 0.95):
        yield f"{np.quantile(times, share):.3f}" if len(times) else NOTHING
    for name in ("joint_path_length", "max_chaser_euler"):
        values = group.values(name)
        yield METRIC_BY_NAME[name].shown(float(np.median(values))) if len(values) else NOTHING
    values = group.values("min_clearance")
    yield f"{1e3 * values.min():.2g}" if len(values) else NOTHING  # positive, however small


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
    causes = sorted({cause for group in methods for cause in group.causes}, key=_number)
    if not causes:
        return
    yield element("h2", "Causes of refusal")
    cells = ([_class(c), c, *(str(group.causes[c]) for group in methods)] for c in causes)
    columns = ("class", "cause", *(group.name for group in methods))
    yield table(columns, [row(one) for one in cells])
    for group in methods:
        impossible = sum(n for cause, n in group.causes.items() if _number(cause) < _NO_PLAN)
        if 0 < impossible < group.solved.total:
            rest = Rate(group.solved.count, group.solved.total - impossible)
            low, high = rest.interval
            words = (
                f"{group.name}: of the {rest.total} cases whose task is possible so far as is "
                f"known at the start, {rest.count} are solved: {rest.share:.1%} ({low:.1%} to "
                f"{high:.1%})."
            )
            yield element("p", words)


def _number(cause: str) -> int:
    return Status[cause.upper()]


def _class(cause: str) -> str:
    if _number(cause) < _NO_PLAN:
        return "the task itself: no method may start from it"
    return "no plan was found" if _number(cause) < _DEFECT else "a defect of the planner"


def _varied(rows: Sequence[Row], methods: Sequence[Group]) -> Iterator[Element]:
    columns = [name for name in rows[0] if name.startswith("change.")]
    numeric = [n for n in columns if any(isinstance(one[n], int | float) for one in rows)]
    if not numeric:
        return
    yield element("h2", "What was varied")
    apart = grouped(rows, "source", "method")
    groups = apart if len(apart) <= _MOST_CURVES else methods
    for place, column in enumerate(numeric[:_MOST_VARIED]):
        name = column.removeprefix("change.")
        caption = f"Share of cases that are solved by {name}; bars are 95 % confidence intervals."
        yield plot(f"varied-{place}", varied_plot(name, column, groups), caption)


def _worst(directory: Path, methods: Sequence[Group]) -> Iterator[Element]:
    yield element("h2", "Worst cases")
    words = "Each command plans its case again; the scenario files are beside the tables."
    yield element("p", words)
    rows: list[Element] = []
    columns = ("why", "method", "scenario", "time [s]")
    for group in methods:
        for why, case in worst(group.rows, _MOST_WORST):
            time = "-" if case["solve_time"] is None else f"{case['solve_time']:.3f}"
            rows.append(row((why, case["method"], case["source"], time)))
            if not case["solved"]:
                rows.append(_below(case["message"], "reason", len(columns)))
            if values := _changes(case):
                told = ", ".join(f"{key} {_short(value)}" for key, value in values.items())
                rows.append(_below(told, "more", len(columns)))
            rows.append(_below(_command(case, directory), "more", len(columns)))
    yield table(columns, rows)


def _below(what: Element | str, kind: str, columns: int) -> Element:
    """Return a row that says more on the one above."""
    return element("tr", element("td", what, colspan=str(columns)), {"class": kind})


def _changes(case: Row) -> dict[str, Any]:
    try:
        return changes_of(case, "changes")
    except FfPlannerError as error:
        return {"changes": str(error)}


def _command(case: Row, directory: Path) -> Element | str:
    try:
        return element("code", command_again(case, directory))
    except FfPlannerError as error:
        return str(error)


def _short(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
