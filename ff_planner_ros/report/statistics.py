"""What a table of plans says: how often, how surely, how fast and how well."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ff_planner_ros.common.intervals import exact_interval

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Rate:
    """How many of how many."""

    count: int
    total: int

    @property
    def share(self) -> float:
        """The rate that was seen."""
        return self.count / self.total

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % confidence interval."""
        return exact_interval(self.count, self.total)


@dataclass(frozen=True)
class Group:
    """The rows of a method, or of a method on one source."""

    name: str
    rows: Sequence[Row]

    @property
    def solved(self) -> Rate:
        """How many have a plan."""
        return Rate(sum(bool(row["solved"]) for row in self.rows), len(self.rows))

    @property
    def causes(self) -> Counter[str]:
        """How often each status refused."""
        return Counter(row["status"] for row in self.rows if not row["solved"])

    def values(self, column: str, solved_only: bool = True) -> np.ndarray:
        """Return the values of a column, without those that are not known."""
        rows = (row for row in self.rows if row["solved"] or not solved_only)
        return np.array([row[column] for row in rows if row[column] is not None], dtype=float)


def grouped(rows: Iterable[Row], *columns: str) -> list[Group]:
    """Return the rows by what some columns hold, in the order in which that comes first."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in columns), []).append(row)
    return [Group(", ".join(map(str, key)), entries) for key, entries in found.items()]


@dataclass(frozen=True)
class Bin:
    """Rows whose varied value lies between two bounds."""

    lower: float
    upper: float
    rate: Rate  # of those that are solved


def bins(rows: Sequence[Row], column: str, most: int) -> list[Bin]:
    """Return how often rows are solved by a varied number.

    A bin a value where these are few, else `most` bins that hold as many rows each.
    """
    known = [row for row in rows if row.get(column) is not None and math.isfinite(row[column])]
    values = np.array([row[column] for row in known], dtype=float)
    solved = np.array([bool(row["solved"]) for row in known])
    if not len(values):
        return []
    different = np.unique(values)
    if len(different) <= most:
        parts = [values == one for one in different]
    else:
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, most + 1)))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        parts = [place == k for k in range(len(edges) - 1)]
    return [
        Bin(
            float(values[part].min()),
            float(values[part].max()),
            Rate(int(solved[part].sum()), int(part.sum())),
        )
        for part in parts
        if part.any()
    ]


def worst(rows: Sequence[Row], most: int) -> list[tuple[str, Row]]:
    """Return why some rows are looked at first, and these rows: `most` of each kind.

    Refusals by their status, the rarest first; plans that come nearest to something, move the
    joints most, or took longest.
    """
    found: list[tuple[str, Row]] = []
    by_status = grouped((row for row in rows if not row["solved"]), "status")
    for group in sorted(by_status, key=lambda one: len(one.rows)):
        found += [(f"refused: {group.name}", row) for row in group.rows[:most]]
    for words, column, sign in (
        ("least clearance", "min_clearance", 1.0),
        ("longest joint path", "joint_path_length", -1.0),
        ("slowest", "solve_time", -1.0),
    ):
        known = [row for row in rows if row["solved"] and row[column] is not None]
        known.sort(key=lambda row: sign * float(row[column]))
        found += [(words, row) for row in known[:most]]
    return found
