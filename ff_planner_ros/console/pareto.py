"""Picture of plans by joint path and chaser attitude; a click on a plan shows it."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.colours import BLUE, CHOSEN_ROW, PAPER, STYLE, TEXT, VERMILION, css
from ff_planner_ros.console.entries import Entry, clickable

_WIDTH, _HEIGHT, _LEFT, _BELOW, _ROUND = 300, 190, 46, 34, 12  # [pixels]
_TOO_FEW = (
    "Two plans or more are drawn here by joint path and attitude. The button &quot;Pareto "
    "front&quot; makes some that trade one for the other."
)
_AIR = 0.1  # beside the outermost points, in parts of their span


def picture_of(entries: Sequence[Entry], chosen: Entry) -> str:
    """Return the plans over joint path [rad] and attitude [deg] as clickable HTML."""
    planned = [
        (one, metrics.joint_path_length, float(np.rad2deg(metrics.max_chaser_euler)))
        for one in entries
        if one.plan is not None and (metrics := one.metrics) is not None
    ]
    if len(planned) < 2:
        return f"{STYLE}<div class='ff'><p>{_TOO_FEW}</p></div>"
    points = np.array([[length, angle] for _, length, angle in planned])
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    low, high = low - _AIR * span, high + _AIR * span
    size = np.array([_WIDTH - _LEFT - _ROUND, _HEIGHT - _BELOW - _ROUND])
    places = (points - low) / (high - low) * size
    drawn = [_axes(low, high)]
    for (one, length, angle), (right, up) in zip(planned, places, strict=True):
        words = f"{one.name}: joint path {length:.4f} rad, attitude {angle:.3f} deg{_weights(one)}"
        x, y = _LEFT + right, _HEIGHT - _BELOW - up
        is_chosen = one is chosen
        shape = (
            f"<rect x='{x - 6:.1f}' y='{y - 6:.1f}' width='12' height='12' fill='{css(VERMILION)}'"
            if is_chosen
            else f"<circle cx='{x:.1f}' cy='{y:.1f}' r='6' fill='{css(BLUE)}'"
        )
        title = f"<title>{html.escape(words)}</title>"
        drawn.append(f"{shape} stroke='{PAPER}' {clickable(one.name, words)}>{title}")
        drawn.append("</rect>" if is_chosen else "</circle>")
    box = f"viewBox='0 0 {_WIDTH} {_HEIGHT}' width='100%' font-size='10' fill='{TEXT}'"
    return f"{STYLE}<div class='ff'><svg {box}>{''.join(drawn)}</svg></div>"


def _weights(entry: Entry) -> str:
    if entry.task is None:
        return ""
    weights = entry.task.problem.objective
    return f", weights {weights.joint_path_length:g} and {weights.chaser_attitude:g}"


def _axes(low: Array, high: Array) -> str:
    right, top, bottom = _WIDTH - _ROUND, _ROUND, _HEIGHT - _BELOW
    middle = (top + bottom) / 2
    return (
        f"<rect x='{_LEFT}' y='{top}' width='{right - _LEFT}' height='{bottom - top}' "
        f"fill='{CHOSEN_ROW}' stroke='{TEXT}'/>"
        f"<text x='{_LEFT}' y='{bottom + 12}'>{low[0]:.3g}</text>"
        f"<text x='{right}' y='{bottom + 12}' text-anchor='end'>{high[0]:.3g}</text>"
        f"<text x='{(_LEFT + right) / 2}' y='{bottom + 24}' text-anchor='middle'>"
        "joint path [rad]</text>"
        f"<text x='{_LEFT - 4}' y='{bottom}' text-anchor='end'>{low[1]:.3g}</text>"
        f"<text x='{_LEFT - 4}' y='{top + 8}' text-anchor='end'>{high[1]:.3g}</text>"
        f"<text transform='translate(12 {middle}) rotate(-90)' text-anchor='middle'>"
        "attitude [deg]</text>"
    )
