"""Cells of a study's map over two of its quantities, and the cases in each cell."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ff_planner_ros.report.study.columns import Column

# As in the report: up to so many values have a cell each, more are divided into equal parts.
_MOST_VALUES, _FEWEST_PARTS, _MOST_PARTS = 16, 3, 12


@dataclass(frozen=True)
class Axis:
    """A quantity along one side of a map, in places."""

    name: str  # of the quantity, with its unit
    words: tuple[str, ...]  # of each place
    places: tuple[int | None, ...]  # of each case; None: its value is not known


@dataclass(frozen=True)
class Plane:
    """The cells with any case, by their places across and up."""

    across: Axis
    up: Axis
    cells: dict[tuple[int, int], tuple[int, ...]]  # numbers of the cases


def plane(across: Column, up: Column, cases: Collection[int]) -> Plane:
    """Return the cells of some cases, given by their numbers, over two quantities."""
    axes = axis_of(across, cases), axis_of(up, cases)
    cells = dict[tuple[int, int], tuple[int, ...]]()
    for case in cases:
        x, y = (axis.places[case] for axis in axes)
        if x is not None and y is not None:
            cells[x, y] = (*cells.get((x, y), ()), case)
    return Plane(*axes, cells)


def axis_of(column: Column, cases: Collection[int]) -> Axis:
    """Return the axis of some cases: a place per value if these are few or words, else parts."""
    known = [value for case in cases if (value := column.values[case]) is not None]
    different = sorted(set(known))
    if column.labels is not None or len(different) <= _MOST_VALUES:
        number = {value: place for place, value in enumerate(different)}
        labels = column.labels
        words = (_short(one) if labels is None else labels[int(one)] for one in different)
        return Axis(column.name, tuple(words), _placed(column.values, number.get))
    parts = round(float(np.clip(np.sqrt(len(known)) / 2, _FEWEST_PARTS, _MOST_PARTS)))
    edges = np.linspace(different[0], different[-1], parts + 1)
    words = (f"{_short(a)} to {_short(b)}" for a, b in pairwise(edges))

    def part(value: float) -> int:
        return int(np.clip(np.searchsorted(edges, value, side="right") - 1, 0, parts - 1))

    return Axis(column.name, tuple(words), _placed(column.values, part))


def _placed(
    values: Sequence[float | None], place: Callable[[float], int | None]
) -> tuple[int | None, ...]:
    return tuple(None if value is None else place(value) for value in values)


def _short(value: float) -> str:
    return f"{value:.4g}"
