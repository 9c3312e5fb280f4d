"""The heat map of a study: a click on a cell shows the plan or the refusal of its case."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.colours import (
    CAUSES,
    COSTS,
    PAPER,
    RGB,
    STYLE,
    TEXT,
    VERMILION,
    css,
)
from ff_planner_ros.console.entries import clickable
from ff_planner_ros.console.study.cells import Axis, Plane

_WIDTH, _HEIGHT, _LEFT, _BELOW, _ROUND = 380, 270, 62, 40, 6  # [pixels]
_NARROW = 24.0  # no words stand in, or below, smaller cells [pixels]


@dataclass(frozen=True)
class Case:
    """One case of a map."""

    name: str  # passed on by a click
    cost: float | None  # None: it has no plan, or no such metric
    status: str | None  # of the refusal; None: it has a plan


def heat_map(
    plane: Plane,
    cases: Sequence[Case],
    cost: str,
    words_of: dict[str, str],
    chosen: str,
) -> str:
    """Return the map as clickable HTML.

    Args:
        cases: All cases of the study, by number.
        cost: Name of the metric that colours cells with a plan, with its unit.
        words_of: Code and name of each status of a refusal, in the order of the colours.
        chosen: Name of the case that is shown.
    """
    medians = {at: _median([cases[k] for k in cell]) for at, cell in plane.cells.items()}
    known = [value for value in medians.values() if value is not None]
    low, high = (min(known), max(known)) if known else (0.0, 0.0)
    colours = {status: CAUSES[k % len(CAUSES)] for k, status in enumerate(words_of)}
    wide = (_WIDTH - _LEFT - _ROUND) / max(len(plane.across.words), 1)
    tall = (_HEIGHT - _BELOW - _ROUND) / max(len(plane.up.words), 1)
    drawn, above, seen = [_axes(plane, wide, tall)], "", dict[str, None]()
    for (x, y), cell in sorted(plane.cells.items()):
        found = [cases[k] for k in cell]
        cause = _cause(found) if all(one.status for one in found) else None
        if cause is not None:
            seen[cause] = None
        value = medians[x, y]
        colour = css(
            colours[cause]
            if cause is not None
            else _shade((value - low) / (high - low) if value is not None and high > low else 0.0)
        )
        place = (_LEFT + x * wide, _HEIGHT - _BELOW - (y + 1) * tall)
        told = _told(plane, (x, y), found, cost, value, words_of)
        is_chosen = any(one.name == chosen for one in found)
        box = (
            f"<rect x='{place[0]:.1f}' y='{place[1]:.1f}' width='{wide:.1f}' height='{tall:.1f}' "
            f"fill='{colour}' stroke='{css(VERMILION) if is_chosen else PAPER}' "
            f"stroke-width='{3 if is_chosen else 1}' {clickable(_next(found, chosen), told)}>"
            f"<title>{html.escape(told)}</title></rect>"
        )
        if cause is not None and wide >= _NARROW:
            code = words_of[cause].partition(" ")[0]
            box += (
                f"<text x='{place[0] + wide / 2:.1f}' y='{place[1] + tall / 2 + 3:.1f}' "
                f"text-anchor='middle' pointer-events='none'>{html.escape(code)}</text>"
            )
        # The frame of what is chosen lies above its neighbours.
        if is_chosen:
            above = box
        else:
            drawn.append(box)
    view = f"viewBox='0 0 {_WIDTH} {_HEIGHT}' width='100%' font-size='10' fill='{TEXT}'"
    legend = _legend(cost, (low, high) if known else None, {k: words_of[k] for k in seen}, colours)
    return f"{STYLE}<div class='ff'><svg {view}>{''.join(drawn)}{above}</svg>{legend}</div>"


def _next(cell: Sequence[Case], chosen: str) -> str:
    """Return the case that a click on a cell shows: each click the next one."""
    names = [one.name for one in cell]
    return names[(names.index(chosen) + 1) % len(names)] if chosen in names else names[0]


def _median(cell: Sequence[Case]) -> float | None:
    known = [one.cost for one in cell if one.cost is not None]
    return float(np.median(known)) if known else None


def _cause(cell: Sequence[Case]) -> str:
    """Return the most frequent status of refusal in a cell."""
    causes = [one.status for one in cell if one.status is not None]
    return max(dict.fromkeys(causes), key=causes.count)


def _shade(share: float) -> RGB:
    """Return the colour of a cost, from the least, 0, to the most, 1."""
    at: Array = np.linspace(0.0, 1.0, len(COSTS))
    red, green, blue = (round(float(np.interp(share, at, part))) for part in np.array(COSTS).T)
    return red, green, blue


def _told(
    plane: Plane,
    at: tuple[int, int],
    cell: Sequence[Case],
    cost: str,
    value: float | None,
    words_of: dict[str, str],
) -> str:
    lines = [
        f"{axis.name}: {axis.words[k]}"
        for axis, k in zip((plane.across, plane.up), at, strict=True)
    ]
    solved = sum(one.status is None for one in cell)
    lines.append(
        f"{len(cell)} cases, {solved} solved"
        if len(cell) > 1
        else "solved"
        if solved
        else f"refused: {words_of[_cause(cell)]}"
    )
    if value is not None:
        lines.append(f"{cost}: {value:.4g}")
    return ", ".join(lines)


def _axes(plane: Plane, wide: float, tall: float) -> str:
    bottom, middle = _HEIGHT - _BELOW, (_ROUND + _HEIGHT - _BELOW) / 2
    words = [
        f"<text x='{_LEFT + (k + 0.5) * wide:.1f}' y='{bottom + 12}' text-anchor='middle'>"
        f"{html.escape(plane.across.words[k])}</text>"
        for k in _shown(plane.across, wide, 2.0 * _NARROW)
    ]
    words += [
        f"<text x='{_LEFT - 4}' y='{bottom - (k + 0.5) * tall + 3:.1f}' text-anchor='end'>"
        f"{html.escape(plane.up.words[k])}</text>"
        for k in _shown(plane.up, tall, 0.5 * _NARROW)
    ]
    words.append(
        f"<text x='{(_LEFT + _WIDTH - _ROUND) / 2}' y='{bottom + 30}' text-anchor='middle'>"
        f"{html.escape(plane.across.name)}</text>"
        f"<text transform='translate(10 {middle}) rotate(-90)' text-anchor='middle'>"
        f"{html.escape(plane.up.name)}</text>"
    )
    return "".join(words)


def _shown(axis: Axis, size: float, room: float) -> range:
    """Return the places whose words have room beside each other."""
    return range(0, len(axis.words), max(1, int(np.ceil(room / size))))


def _legend(
    cost: str,
    span: tuple[float, float] | None,
    seen: dict[str, str],
    colours: dict[str, RGB],
) -> str:
    words = []
    if span is not None:
        shades = ", ".join(css(one) for one in COSTS)
        words.append(
            f"<p>{html.escape(cost)}: {span[0]:.4g} <span style='display:inline-block;width:80px;"
            f"height:9px;background:linear-gradient(to right, {shades})'></span> {span[1]:.4g}</p>"
        )
    for status, said in seen.items():
        words.append(
            "<p><span style='display:inline-block;width:9px;height:9px;"
            f"background:{css(colours[status])}'></span> {html.escape(said)}</p>"
        )
    return "".join(words)
