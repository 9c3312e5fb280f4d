"""The worst cases of a campaign: why, by how much, and how to plan them again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from ff_planner_ros.campaign.again import changes_of, command_again, scenario_again
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.report.html import element, row, table
from ff_planner_ros.report.statistics import Group, Row, grouped

_MOST = 3  # of each kind
# What makes a plan one of the worst: words, metric, and whether the least or the largest.
_KINDS = (
    ("least clearance", "min_clearance", 1.0),
    ("least self-clearance", "min_self_clearance", 1.0),
    ("largest chaser rotation", "max_chaser_rotation", -1.0),
    ("longest joint path", "joint_path_length", -1.0),
)
_COLUMNS = ("why", "figure", "method", "scenario", "plan")


@dataclass(frozen=True)
class WorstCase:
    """A case, and why it is one of the worst."""

    why: str
    figure: str  # value of the quantity in `why`, or number of such cases
    row: Row


def worst_cases(methods: Sequence[Group]) -> list[WorstCase]:
    """Return the worst cases of each method.

    They are one case of each status of refusal, the rarest first, and the plans with the smallest
    clearances, the largest rotations, the longest paths and the longest solve times.
    """
    return [one for group in methods for one in _of_method(group.rows)]


def _of_method(rows: Sequence[Row]) -> Iterator[WorstCase]:
    refused = grouped((row for row in rows if not row["solved"]), "status")
    for group in sorted(refused, key=lambda one: len(one.rows)):
        count = len(group.rows)
        yield WorstCase(
            f"refused: {group.name}", "1 case" if count == 1 else f"{count} cases", group.rows[0]
        )
    for words, name, sign in _KINDS:
        metric = METRIC_BY_NAME[name]
        for one in _extreme(rows, name, sign):
            yield WorstCase(words, metric.text(one[name]), one)
    for one in _extreme(rows, "solve_time", -1.0):
        yield WorstCase("slowest plan", f"{one['solve_time']:.3f} s", one)


def _extreme(rows: Sequence[Row], name: str, sign: float) -> list[Row]:
    known = [row for row in rows if row["solved"] and row.get(name) is not None]
    return sorted(known, key=lambda row: sign * float(row[name]))[:_MOST]


def worst_section(
    directory: Path, cases: Sequence[WorstCase], pages: Mapping[str, str]
) -> Iterator[Element]:
    """Yield the section of a report on the worst cases.

    Args:
        directory: Directory of the campaign.
        cases: See `worst_cases`.
        pages: Links to pages of cases, by case id, relative to the report.
    """
    yield element("h2", "Worst cases")
    words = "Each command plans its case again; the scenario files are beside the tables."
    yield element("p", words)
    rows: list[Element] = []
    for one in cases:
        case, page = one.row, pages.get(one.row["id"])
        link = case["id"] if page is None else element("a", case["id"], href=page)
        rows.append(row((one.why, one.figure, case["method"], case["source"], link)))
        if not case["solved"]:
            rows.append(_below(case["message"], "reason"))
        if values := _changes(case):
            told = ", ".join(f"{key} {_short(value)}" for key, value in values.items())
            rows.append(_below(told, "more"))
        rows.append(_below(_command(case, directory), "more"))
    yield table(_COLUMNS, rows)


def _below(what: Element | str, kind: str) -> Element:
    """Return a row of details on the row above."""
    return element("tr", element("td", what, colspan=str(len(_COLUMNS))), {"class": kind})


def _changes(case: Row) -> dict[str, Any]:
    try:
        return changes_of(case, "changes")
    except FfPlannerError as error:
        return {"changes": str(error)}


def _command(case: Row, directory: Path) -> Element | str:
    try:
        command = command_again(case, directory, scenario_again(case, directory))
        return element("code", command)
    except FfPlannerError as error:
        return str(error)


def _short(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
