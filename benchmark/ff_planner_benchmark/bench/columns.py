"""Cells of tables, from rows of results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ff_planner_benchmark.bench.experiment import Cell, Row, Rows, is_solved
from ff_planner_ros.common.intervals import percent


def count(rows: Rows) -> str:
    """Return the number of rows."""
    return f"{len(rows)}"


def number_of(of: Callable[[Row], Any]) -> Cell:
    """Return a cell of the number of rows for which something holds."""
    return lambda rows: f"{sum(bool(of(row)) for row in rows)}"


def share(of: Callable[[Row], Any], digits: int = 1) -> Cell:
    """Return a cell of the share of rows for which something holds."""

    def cell(rows: Rows) -> str:
        part = sum(bool(of(row)) for row in rows) / max(len(rows), 1)
        return percent(part, digits) if rows else "-"

    return cell


def value(
    key: str, of: Callable[[Any], Any] = np.median, form: str = ".3f", unit: float = 1
) -> Cell:
    """Return a cell of what a function makes of known values, times `unit`; `-` of none."""

    def cell(rows: Rows) -> str:
        known = [unit * row[key] for row in rows if row[key] is not None]
        return f"{of(known):{form}}" if known else "-"

    return cell


def text(key: str, form: str = "", unknown: str = "-") -> Cell:
    """Return a cell of the value of a group's first row, as it is."""
    return lambda rows: unknown if rows[0][key] is None else f"{rows[0][key]:{form}}"


def among(cell: Cell, *where: Callable[[Row], Any]) -> Cell:
    """Return a cell of only those rows for which all of this holds."""
    return lambda rows: cell([row for row in rows if all(of(row) for of in where)])


def ratio(key: str, by: str, of: str, over: str, form: str = ".3f") -> Cell:
    """Return the median ratio of a value between two variants, where both are solved.

    Args:
        by: Name of the value that tells the variants apart; of both the rows are in one order.
        of: Its value where the numerator is.
        over: Its value where the denominator is.
    """

    def cell(rows: Rows) -> str:
        first, second = ([row for row in rows if row[by] == one] for one in (of, over))
        known = [
            one[key] / other[key]
            for one, other in zip(first, second, strict=True)
            if is_solved(one) and is_solved(other) and one[key] and other[key]
        ]
        return f"{np.median(known):{form}}" if known else "-"

    return cell


solved = share(is_solved)
quantile_90, quantile_95, quantile_99 = (partial(np.quantile, q=q) for q in (0.9, 0.95, 0.99))
TIMES: Mapping[str, Cell] = {
    "solved": solved,
    "median [s]": value("seconds"),
    "95 % [s]": value("seconds", quantile_95),
}
WORST: Mapping[str, Cell] = {"worst [s]": value("seconds", max)}
