"""Columns of a campaign's table that its plots show: varied quantities and metrics."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ff_planner_ros.campaign.part_file import CHANGE
from ff_planner_ros.common.forms import Schema
from ff_planner_ros.planning.motion.metrics import METRICS
from ff_planner_ros.planning.scenario.scenario import scenario_schema
from ff_planner_ros.report.statistics import Row

# Digits of a number that a picture shows; more would make the page larger.
_DIGITS = 6
_MOST_WORDS = 30  # that stand along an axis


@dataclass(frozen=True)
class Column:
    """A varied quantity, or a metric, with a value for each row."""

    name: str  # with its unit
    key: str  # varied key of the scenario, or name of the metric
    values: Sequence[float | None]  # None: not known
    labels: Sequence[str] | None = None  # texts that the values index; None: values are numbers
    of_all: bool = False  # whether refused cases have a value, too

    @property
    def known(self) -> list[float]:
        """The values that are known."""
        return [value for value in self.values if value is not None]

    def document(self) -> dict[str, Any]:
        """Return the column for JSON."""
        told: dict[str, Any] = {"name": self.name, "values": list(self.values)}
        told |= {} if self.labels is None else {"labels": list(self.labels)}
        return told | ({"of_all": True} if self.of_all else {})


def words(name: str, texts: Sequence[str]) -> Column:
    """Return a column of texts, numbered in alphabetical order."""
    labels = sorted(set(texts))
    number = {text: k for k, text in enumerate(labels)}
    return Column(name, name, [number[text] for text in texts], labels)


def quantities(rows: Sequence[Row]) -> list[Column]:
    """Return the varied quantities: numbers, texts, and the norm and components of vectors.

    Constant columns, and columns of too many different texts, are left out.
    """
    keys = [name for name in (rows[0] if rows else ()) if name.startswith(CHANGE)]
    found = [one for key in keys for one in _quantities(key, [row.get(key) for row in rows])]
    return [
        one for one in found if len(set(one.known)) > 1 and len(one.labels or ()) <= _MOST_WORDS
    ]


def _quantities(key: str, cells: Sequence[Any]) -> Iterator[Column]:
    name, known = key.removeprefix(CHANGE), [cell for cell in cells if cell is not None]
    unit = f" [{found}]" if (found := unit_of(name)) else ""
    if any(isinstance(cell, str) for cell in known):
        yield words(name, ["-" if cell is None else str(cell).strip('"') for cell in cells])
    elif any(isinstance(cell, list) for cell in known):
        size = max(map(len, known))
        vectors = [_vector(cell, size) for cell in cells]
        norms = [None if one is None else _short(np.linalg.norm(one)) for one in vectors]
        yield Column(f"|{name}|{unit}", name, norms)
        for k in range(size):
            entries = [None if one is None else _short(one[k]) for one in vectors]
            yield Column(f"{name}[{k}]{unit}", name, entries)
    else:
        yield Column(f"{name}{unit}", name, [_short(cell) for cell in cells])


def unit_of(key: str) -> str:
    """Return the unit of a varied key, from the schema of scenarios; empty: it has none."""
    if key.startswith("turn."):
        return "deg"
    if key.startswith("urdf."):
        return "kg" if key.endswith(".mass") else "kg m2" if ".inertia." in key else ""
    steps = re.findall(r"[^.\[\]]+", key)
    for words in _described(_schema(), steps):
        if unit := re.search(r"\[([^\[\]]+)\]\.$", words):
            return unit[1]
    return ""


@cache
def _schema() -> Schema:
    return scenario_schema()


def _described(node: Schema, steps: Sequence[str]) -> Iterator[str]:
    """Yield the descriptions of a value in a schema; numbers in a list have the list's."""
    for one in (node, *node.get("anyOf", ()), *node.get("oneOf", ())):
        inner, items = one.get("properties", {}), one.get("items", {})
        if not steps or items.get("type") == "number":
            yield one.get("description", "")
        elif steps[0] in inner:
            yield from _described(inner[steps[0]], steps[1:])
        elif items:  # by its number, or by its id
            yield from _described(items, steps[1:])


def _vector(cell: Any, size: int) -> Sequence[float] | None:
    """Return a vector; None: it has another size, or an unknown component."""
    if not isinstance(cell, list) or len(cell) != size or None in cell:
        return None
    return cell


def metrics(rows: Sequence[Row]) -> list[Column]:
    """Return the solve times of all cases and every metric of plans, in the units of tables."""
    times = [_short(row["solve_time"]) for row in rows]
    found = [Column("time [s]", "time [s]", times, of_all=True)]
    for metric in METRICS:
        unit = f" [{metric.shown_unit}]" if metric.shown_unit else ""
        cells = [row.get(metric.name) if row["solved"] else None for row in rows]
        values = [
            _short(None if cell in (None, []) else metric.in_shown_unit(cell)) for cell in cells
        ]
        found.append(Column(f"{metric.label}{unit}", metric.name, values))
    return [one for one in found if one.known]


def _short(value: Any) -> float | None:
    """Return a number rounded for display; None: it is unknown or not finite."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{_DIGITS}g}")
