"""Plots over time for a browser, where a user can zoom and read single points.

The page arranges the panels to the width of the screen, by the counts in `layout.meta`.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from ff_planner_ros.analysis.drawing.panels import (
    Mark,
    Panel,
    Quantity,
    clearance_panel,
    joint_angles,
    joint_rates,
    joint_torques,
    panels,
)
from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot

_DASHES = {"solid": "solid", "dashed": "dash", "dotted": "dot", "dashdot": "dashdot"}
_FORBIDDEN, _LIMIT, _TEXT = "#d9d9d9", "#595959", "#222222"
_AXIS: dict[str, Any] = {
    "gridcolor": "#e6e6e6",
    "zeroline": False,
    "linecolor": _LIMIT,
    "tickfont": {"size": 11},
}
# Height of a panel without title and ticks [px], and how far the words of a mark are above it.
_PANEL, _LIFT = 110, 24
# A name that is longer would run into the limits beside it; names often differ at their ends only.
_LONGEST, _LAST = 28, 14


def two_column_plot(
    quantities: tuple[Quantity, Quantity], motions: Mapping[Method, Trajectory]
) -> go.Figure:
    """Draw two quantities side by side, a row for each component."""
    left, right = (panels(quantity, motions) for quantity in quantities)
    in_rows = [panel for pair in zip(left, right, strict=True) for panel in pair]
    return panel_plot(in_rows, 2, titles=[quantity.title for quantity in quantities])


def joint_plot(robot: Robot, motions: Mapping[Method, Trajectory]) -> go.Figure:
    """Draw a row for each joint: its position, velocity and torque."""
    quantities = (joint_angles(robot), joint_rates(robot), joint_torques(robot))
    of_joints = zip(*(panels(quantity, motions) for quantity in quantities), strict=True)
    in_rows = [panel for of_joint in of_joints for panel in of_joint]
    return panel_plot(in_rows, len(quantities), titles=[one.title for one in quantities])


def clearance_plot(
    robot: Robot,
    obstacles: Sequence[Obstacle],
    motions: Mapping[Method, Trajectory],
    scene: Scene | None = None,
) -> go.Figure:
    """Draw the distance to the closest obstacle, Fig. 6 of the paper, as `clearance_panel` has it.

    Args:
        scene: See `clearance_panel`.
    """
    panel = clearance_panel(robot, obstacles, motions, scene)
    figure = panel_plot([panel], 1, rows_high=2)
    if not obstacles:
        figure.add_annotation(
            text="no obstacles", x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False
        )
        return figure
    values = np.concatenate([values for _, values in panel.curves.values()])
    values = values[np.isfinite(values)]
    lowest, highest = values.min(initial=0.0), values.max(initial=0.0)
    bottom, top = min(lowest, -0.05 * highest), highest
    figure.add_hrect(
        y0=2 * bottom, y1=0.0, fillcolor=_FORBIDDEN, line_width=0, layer="below", opacity=1
    )
    font = {"size": 11, "color": _LIMIT}
    figure.add_annotation(
        text="inside an obstacle",
        x=1,
        y=0,
        xref="x domain",
        xanchor="right",
        yanchor="top",
        showarrow=False,
        font=font,
    )
    # Room above the curves for what is said of their lowest points.
    figure.update_yaxes(range=[1.2 * bottom, top + 0.3 * (top - bottom)])
    return figure


def panel_plot(
    drawn: Sequence[Panel], columns: int = 2, titles: Sequence[str] = (), rows_high: int = 1
) -> go.Figure:
    """Draw panels row by row, with one legend for all.

    Args:
        titles: Titles of the columns.
        rows_high: Height of each panel, in heights of a usual one.
    """
    curves: list[go.Scatter] = []
    # Everything at once: plotly checks the whole layout at every change.
    layout: dict[str, Any] = {"shapes": [], "annotations": []}
    for number, panel in enumerate(drawn):
        curves += [_curve(method, *curve, number) for method, curve in panel.curves.items()]
        curves += [_point(mark, number) for mark in panel.marks]
        layout[_axis("xaxis", number)] = _AXIS | {
            "anchor": _axis("y", number),
            "matches": "x" if number else None,
            "range": _time_range(drawn),
            "ticksuffix": " s",
            "nticks": 8,
        }
        layout[_axis("yaxis", number)] = _AXIS | {
            "anchor": _axis("x", number),
            "exponentformat": "e",
            "nticks": 5 * rows_high,
            "range": panel.span,
        }
        layout["shapes"] += _levels(panel, number)
        layout["annotations"] += [
            *_words_above(panel, number, titles[number] if number < len(titles) else ""),
            *(_words_at(mark, number, k, panel) for k, mark in enumerate(panel.marks)),
        ]
    methods = {method for panel in drawn for method in panel.curves}
    return go.Figure(
        curves,
        layout
        | {
            "margin": {"l": 56, "r": 12, "t": 0, "b": 0},
            "showlegend": len(methods) > 1,
            "legend": {"orientation": "h", "x": 0.5, "xanchor": "center", "y": 1, "yanchor": "top"},
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": _TEXT},
            "plot_bgcolor": "#ffffff",
            "paper_bgcolor": "#ffffff",
            "hovermode": "x",
            "template": "none",
            "meta": {
                "panels": len(drawn),
                "columns": columns,
                "headed": len(titles),
                "height": _PANEL * rows_high,
            },
        },
    )


def _time_range(drawn: Sequence[Panel]) -> list[float]:
    times = np.concatenate([time for panel in drawn for time, _ in panel.curves.values()])
    return [float(times.min()), float(times.max())]


def _axis(kind: str, number: int) -> str:
    """Return plotly's name of an axis of a panel: `x`, `x2`, `x3`, ..."""
    return kind if number == 0 else f"{kind}{number + 1}"


def _curve(method: Method, time: Array, values: Array, number: int) -> go.Scatter:
    return go.Scatter(
        x=time,
        y=values,
        xaxis=_axis("x", number),
        yaxis=_axis("y", number),
        mode="lines",
        name=method.label,
        legendgroup=method.name,
        showlegend=number == 0,
        line={"color": method.colour, "dash": _DASHES[method.dash], "width": 2},
        hovertemplate="%{y:.5g}",
    )


def _point(mark: Mark, number: int) -> go.Scatter:
    return go.Scatter(
        x=[mark.time],
        y=[mark.value],
        xaxis=_axis("x", number),
        yaxis=_axis("y", number),
        mode="markers",
        name="least",
        legendgroup=mark.method.name,
        showlegend=False,
        marker={"color": mark.method.colour, "size": 9, "line": {"color": "#ffffff", "width": 1}},
        hoverinfo="skip",
    )


def _words_above(panel: Panel, number: int, title: str) -> list[dict[str, Any]]:
    """Return what stands above a panel: its name, its limits, and the title of its column."""
    above = {
        "xref": f"{_axis('x', number)} domain",
        "yref": f"{_axis('y', number)} domain",
        "y": 1,
        "yanchor": "bottom",
        "showarrow": False,
    }
    left, right = above | {"x": 0, "xanchor": "left"}, above | {"x": 1, "xanchor": "right"}
    font = {"size": 11, "color": _LIMIT}
    words = [
        left | {"text": _plain(panel.label)},
        right | {"text": panel.note, "font": font},
        left | {"text": f"<b>{html.escape(title)}</b>", "yshift": 20, "font": {"size": 13}},
    ]
    return [one for one, text in zip(words, (panel.label, panel.note, title), strict=True) if text]


def _words_at(mark: Mark, number: int, place: int, panel: Panel) -> dict[str, Any]:
    """Return what is said of a marked point, above it and towards the middle of the panel."""
    last = max(float(time[-1]) for time, _ in panel.curves.values())
    side = "left" if mark.time < last / 2 else "right"
    return {
        "text": html.escape(mark.words),
        "xref": _axis("x", number),
        "yref": _axis("y", number),
        "x": mark.time,
        "y": mark.value,
        "ax": 14 if side == "left" else -14,
        "ay": -_LIFT * (place + 1),
        "xanchor": side,
        "arrowcolor": mark.method.colour,
        "arrowwidth": 1,
        "bgcolor": "rgba(255, 255, 255, 0.85)",
        "font": {"color": mark.method.colour},
    }


def _levels(panel: Panel, number: int) -> list[dict[str, Any]]:
    """Return a line across the panel for each limit."""
    return [
        {
            "type": "line",
            "xref": f"{_axis('x', number)} domain",
            "yref": _axis("y", number),
            "x0": 0,
            "x1": 1,
            "y0": level,
            "y1": level,
            "line": {"color": _LIMIT, "dash": "dash", "width": 1},
        }
        for level in panel.levels
        if np.isfinite(level)
    ]


def _plain(label: str) -> str:
    """Return a label as HTML: shortened, escaped, with indices as subscripts."""
    name, bracket, unit = label.rpartition(" [")
    if len(name) > _LONGEST:
        label = f"{name[: _LONGEST - _LAST - 1]}…{name[-_LAST:]}{bracket}{unit}"
    return re.sub(r"\$(\w)_(\w)\$", r"\1<sub>\2</sub>", html.escape(label)).replace("$", "")
