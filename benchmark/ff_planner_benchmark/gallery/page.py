"""The page of published problems, from the figures of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from ff_planner_benchmark.gallery.plans import SOLVED
from ff_planner_benchmark.gallery.problems import PROBLEMS, Problem
from ff_planner_benchmark.gallery.reach import summary

_MODELS = "../../benchmark/ff_planner_benchmark/gallery/models"

# The first part of the page
_HEAD = Path(__file__).with_name("head.md")

_RECOMPUTED = ("quantity", "unit", "printed", "ours", "by", "agrees")
_PLANS = (
    *("task", "published", "last turn [deg]", "largest turn [deg]", "missed by [mm]"),
    *("[deg]", "joint path [rad]", "time [s]", "MuJoCo [mm]", "Drake [mm]", "Basilisk [mm]"),
)


def page(figures: dict[str, Any]) -> str:
    """Return the page of the figures of a run, as Markdown."""
    lines = [*_HEAD.read_text(encoding="utf-8").splitlines(), ""]
    machine = figures["machine"]
    lines += [f"Measured on {machine['machine']}; {machine['versions']}; {machine['date']}.", ""]
    for name, problem in PROBLEMS.items():
        if name in figures["problems"]:
            lines += [*_section(name, problem, figures["problems"][name]), ""]
        if name == "P5" and "reach" in figures:
            lines += [*summary(figures["reach"]), ""]
    return "\n".join(lines).rstrip() + "\n"


def _section(name: str, problem: Problem, figures: dict[str, Any]) -> Iterator[str]:
    yield f"## {name}. {problem.title}"
    yield ""
    models = ", ".join(f"[{one}.urdf]({_MODELS}/{one}.urdf)" for one in problem.models)
    yield from _wrapped(f"- Source: {problem.source}.")
    yield f"- Model: {models}."
    yield from _wrapped(f"- Left open: {problem.left_open}.")
    yield from _wrapped(f"- Their motion: {problem.method or 'none is published'}.")
    if problem.remark:
        yield ""
        yield from _wrapped(problem.remark)
    rows = figures.get("recomputed", [])
    if rows:
        yield ""
        yield from table(_RECOMPUTED, [_recomputed(row) for row in rows])
        near = [row for row in rows if row["remark"] and not row["rounds"]]
        for remark in dict.fromkeys(row["remark"] for row in near):
            of = ", ".join(row["what"] for row in near if row["remark"] == remark)
            yield ""
            yield from _wrapped(f"*Nearly*, {of}: {remark}.")
    plans = figures.get("plans", [])
    if plans:
        yield ""
        yield from table(_PLANS, [_planned(row) for row in plans])
        for row in plans:
            if row["status"] != SOLVED:
                yield ""
                yield from _wrapped(f"*{row['what']}*, not planned: {row['message']}")
    if "bound" in figures:
        yield ""
        yield from _wrapped(figures["bound"])
    if "goals" in figures:
        yield ""
        yield from _goals(figures["goals"])


def _wrapped(text: str) -> Iterator[str]:
    indent = "  " if text.startswith("- ") else ""
    yield from wrap(text, 118, subsequent_indent=indent, break_on_hyphens=False)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    yield "| " + " | ".join(header) + " |"
    yield "| " + " | ".join("---" for _ in header) + " |"
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def _recomputed(row: dict[str, Any]) -> Sequence[str]:
    digits = len(row["printed"].partition(".")[2])
    ours, agrees = f"{row['ours']:.{digits + 1}f}", "yes" if row["rounds"] else "nearly"
    if not row["agrees"]:
        agrees = "no"
    return row["what"], row["unit"], row["printed"], ours, row["by"], agrees


def _planned(row: dict[str, Any]) -> Sequence[str]:
    told = row["what"], row["published"] or "-"
    if row["status"] != SOLVED:
        return *told, *("-",) * 5, f"{row['seconds']:.2f}", *("-",) * 3
    forms = {"turn_deg": ".4f", "peak_deg": ".4f", "position_mm": ".4f", "attitude_deg": ".5f"}
    forms |= {
        "path_rad": ".3f",
        "seconds": ".2f",
        "MuJoCo": ".4f",
        "Drake": ".4f",
        "Basilisk": ".4f",
    }
    return *told, *(format(row[key], form) if key in row else "-" for key, form in forms.items())


def _goals(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield what became of drawn goals."""
    found = [row for row in rows if row["status"] == SOLVED]
    near = sum(row["position_mm"] <= 1.0 for row in found)
    median, most, largest = np.percentile([row["turn_deg"] for row in found], [50, 95, 100])
    seconds = [row["seconds"] for row in rows]
    worst = max(row["position_mm"] for row in found)
    columns = {
        "goals": str(len(rows)),
        "within 1 mm": str(near),
        "share": f"{100.0 * near / len(rows):.1f} %",
        "worst error [mm]": f"{worst:.4f}",
        "last turn, median [deg]": f"{median:.2f}",
        "95 %": f"{most:.2f}",
        "largest": f"{largest:.2f}",
        "time, median [s]": f"{float(np.median(seconds)):.2f}",
        "of all [s]": f"{sum(seconds):.0f}",
    }
    yield from table([*columns], [[*columns.values()]])
    for row in rows:
        if row["status"] != SOLVED:
            yield ""
            yield from _wrapped(f"Goal {row['number']}, not planned: {row['message']}")
