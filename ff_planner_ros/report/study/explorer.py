"""Interactive plots of a campaign: the reader chooses axes, metrics and filters."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from ff_planner_ros.errors import Status
from ff_planner_ros.report.html import element
from ff_planner_ros.report.statistics import Row
from ff_planner_ros.report.statistics_plots import evenly_spaced
from ff_planner_ros.report.study.columns import Column, metrics, quantities, words

# More cases make the page large, and a cell of a map no surer.
_MOST_CASES = 20_000
_DATA = "study-cases"
# Metrics that the maps show at first.
_FIRST, _SECOND = "joint_path_length", "max_chaser_rotation"


def explorer(directory: Path, rows: Sequence[Row], pages: Mapping[str, str]) -> list[Element]:
    """Return the interactive plots of a campaign's rows, and their data.

    Args:
        directory: Directory of the campaign, for the command that draws a plan.
        pages: Links to pages of cases, by case id, relative to the report.
    """
    shown = [rows[k] for k in evenly_spaced(len(rows), _MOST_CASES)]
    varied, measured = quantities(shown), metrics(shown)
    statuses = sorted({row["status"] for row in shown}, key=code_of)
    random = any(row.get("drawn") for row in rows)
    told = {
        "ids": [row["id"] for row in shown],
        "solved": [bool(row["solved"]) for row in shown],
        "status": [statuses.index(row["status"]) for row in shown],
        "statuses": [
            {"code": code_of(one), "words": f"{code_of(one)} {one.upper()}"} for one in statuses
        ],
        "sources": words("scenario", [row["source"] for row in shown]).document(),
        "methods": _methods(shown).document(),
        "quantities": [one.document() for one in varied],
        "metrics": [one.document() for one in measured],
        "pages": {row["id"]: pages[row["id"]] for row in shown if row["id"] in pages},
        "drawn": random,
        "command": shlex.join(["ff-planner", "campaign", "report", str(directory), "--case", ""])[
            :-2
        ],
        "chosen": _first_shown(varied, measured, random),
    }
    # As plotly writes it: no name in it can end the script.
    text = json.dumps(told, separators=(",", ":")).replace("<", "\\u003c")
    data = element("script", text, {"type": "application/json", "id": _DATA})
    made = element("section", {"class": "explorer", "data-cases": _DATA})
    if len(shown) < len(rows):
        made.append(element("p", f"Of {len(rows)} cases {len(shown)}, evenly among them."))
    if varied:
        made.append(_choices("filters"))
    if len(varied) > 1:
        made.append(element("h3", "Over two quantities"))
        made.append(_choices("axes"))
        both = [
            element("div", _choices(f"{side}-shown"), _place(side)) for side in ("left", "right")
        ]
        made.append(element("div", *both, {"class": "pair"}))
        caption = (
            "A cell shows the median of its solved cases, or the code of what refused most of them "
            "where none is solved. A click lists its cases, and opens the plan of a single one."
        )
        made.append(element("p", caption, {"class": "caption"}))
        made.append(element("div", {"class": "cases wide", "aria-live": "polite"}))
    if varied:
        made.append(element("h3", "Over one quantity"))
        made.extend([_choices("curve-shown"), _place("curve")])
        bars = "Bars are from 5 to 95 % of the cases" if measured else "No case is solved"
        sure = ", of a share the exact 95 % confidence interval" if random else ""
        made.append(element("p", f"{bars}{sure}.", {"class": "caption"}))
    if measured:
        made.append(element("h3", "Distributions"))
        made.extend([_choices("share-shown"), _place("share")])
    return [made, data]


def code_of(status: str) -> int:
    """Return the code of a status, by its name in small letters."""
    return int(Status[status.upper()])


def _methods(rows: Sequence[Row]) -> Column:
    """Return the methods in the order of the study."""
    labels = list(dict.fromkeys(row["method"] for row in rows))
    return Column("method", "method", [labels.index(row["method"]) for row in rows], labels)


def _first_shown(
    varied: Sequence[Column], measured: Sequence[Column], random: bool
) -> dict[str, Any]:
    """Return the initial axes and metrics, by their indices.

    A grid shows a plane: every quantity but the axes is fixed at the middle one of its values.
    """
    number = {one.key: str(k) for k, one in enumerate(measured)}
    first, second = (number.get(name, "cause") for name in (_FIRST, _SECOND))
    # Of a vector its norm stands for it.
    first_of = {one.key: k for k, one in reversed([*enumerate(varied)])}
    firsts = sorted(first_of.values())
    across, up = firsts[:2] if len(firsts) > 1 else (0, 1)
    others = {}
    for k in () if random else firsts[2:]:
        known = sorted(set(varied[k].known))
        others[varied[k].name] = known[len(known) // 2]
    return {
        "across": str(across),
        "up": str(up),
        "left": "solved" if random else first,
        "right": first if random else second,
        "others": others,
    }


def _choices(name: str) -> Element:
    return element("div", {"class": f"choices {name}"})


def _place(name: str) -> Element:
    return element("div", {"class": f"drawn {name}"})
