"""Statistics of a table of plans: success rates with intervals, causes of refusal, values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ff_planner_ros.common.intervals import exact_interval

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Rate:
    """A success rate: `count` of `total`."""

    count: int
    total: int

    @property
    def share(self) -> float:
        """The observed rate, 0 to 1."""
        return self.count / self.total

    @property
    def interval(self) -> tuple[float, float]:
        """The exact 95 % confidence interval of the rate."""
        return exact_interval(self.count, self.total)


@dataclass(frozen=True)
class Group:
    """Rows of a table of plans that share a method, a source or a bag."""

    name: str
    rows: Sequence[Row]

    @property
    def solved(self) -> Rate:
        """The rate of rows with a plan."""
        return Rate(sum(bool(row["solved"]) for row in self.rows), len(self.rows))

    @property
    def is_drawn(self) -> bool:
        """Whether any case was drawn at random, so that the rate has an interval."""
        return any(row.get("drawn") for row in self.rows)

    @property
    def causes(self) -> Counter[str]:
        """Number of refusals by status."""
        return Counter(row["status"] for row in self.rows if not row["solved"])

    def values(self, column: str, solved_only: bool = True) -> np.ndarray:
        """Return the known values of a column, by default of rows with a plan."""
        rows = (row for row in self.rows if row["solved"] or not solved_only)
        return np.array([row[column] for row in rows if row[column] is not None], dtype=float)


def grouped(rows: Iterable[Row], *columns: str) -> list[Group]:
    """Return the rows grouped by their values of some columns, in order of first appearance."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in columns), []).append(row)
    return [Group(", ".join(map(str, key)), entries) for key, entries in found.items()]
