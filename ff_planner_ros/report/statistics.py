"""What a table of plans says: how often, how surely, how fast and how well."""

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
    def is_drawn(self) -> bool:
        """Whether chance had a part in the cases, so that their rate has an interval."""
        return any(row.get("drawn") for row in self.rows)

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
