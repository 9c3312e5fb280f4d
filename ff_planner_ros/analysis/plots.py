"""Plots over time for a browser, where a user can zoom and read single points."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.analysis.panels import Panel, Quantity, clearance, panels
from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.robot.model import Robot

_DASHES = {"solid": "solid", "dashed": "dash", "dotted": "dot", "dashdot": "dashdot"}
_FORBIDDEN, _LIMIT = "#d9d9d9", "#595959"
_AXIS: dict[str, Any] = {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": _LIMIT}
# Heights on the screen [px].
_ROW, _EDGES, _TITLE = 150, 110, 24
# A curve that varies by less is drawn flat, so that rounding is not magnified.
_FLAT = 1e-3


def two_column_plot(
    quantities: tuple[Quantity, Quantity], motions: Mapping[Method, Trajectory]
) -> go.Figure:
    """Draw two quantities side by side, a row for each of their numbers."""
    left, right = (panels(quantity, motions) for quantity in quantities)
    in_rows = [panel for pair in zip(left, right, strict=True) for panel in pair]
    return panel_plot(in_rows, titles=[quantity.title for quantity in quantities])


def clearance_plot(
    robot: Robot, obstacles: Sequence[Sphere], motions: Mapping[Method, Trajectory]
) -> go.Figure:
    """Draw the distance of the arm's centre lines to the closest obstacle: Fig. 6 of the paper."""
    (panel,) = panels(clearance(robot, obstacles), motions)
    figure = panel_plot([panel], columns=1, rows_high=2)
    if not obstacles:
        figure.add_annotation(
            text="no obstacles", x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False
        )
        return figure
    values = np.concatenate([values for _, values in panel.curves.values()])
    bottom, top = min(values.min(), -0.05 * values.max()), max(values.max(), 0.0)
    figure.add_hrect(
        y0=2 * bottom, y1=0.0, fillcolor=_FORBIDDEN, line_width=0, layer="below", opacity=1
    )
    font = {"size": 11, "color": _LIMIT}
    figure.add_annotation(
        text="inside an obstacle", x=1, y=0, xref="paper", yanchor="top", showarrow=False, font=font
    )
    figure.update_yaxes(range=[1.2 * bottom, top + 0.05 * (top - bottom)])
    return figure


def panel_plot(
    drawn: Sequence[Panel], columns: int = 2, titles: Sequence[str] = (), rows_high: int = 1
) -> go.Figure:
    """Draw panels row by row, each as high as `rows_high` usual ones, with one legend for all."""
    rows = -(-len(drawn) // columns)
    figure = make_subplots(
        rows,
        columns,
        shared_xaxes="columns",
        column_titles=list(titles) or None,
        horizontal_spacing=0.11,
        vertical_spacing=min(0.05, 0.2 / rows),
    )
    curves = []
    # Everything at once: plotly checks the whole layout at every change.
    layout: dict[str, Any] = {"shapes": []}
    for number, panel in enumerate(drawn):
        curves += [_curve(method, *curve, number) for method, curve in panel.curves.items()]
        is_lowest = number + columns >= len(drawn)
        layout[_axis("xaxis", number)] = _AXIS | (
            {"title": {"text": "time [s]"}, "showticklabels": True} if is_lowest else {}
        )
        layout[_axis("yaxis", number)] = _AXIS | {
            "title": {"text": _plain(panel.label), "standoff": 4},
            "exponentformat": "e",
            **_range_of(panel),
        }
        layout["shapes"] += _levels(panel, number)
    figure.add_traces(curves)
    figure.update_layout(
        **layout,
        height=_ROW * rows * rows_high + _EDGES,
        margin={"l": 60, "r": 20, "t": 60, "b": 50},
        legend={
            "orientation": "h",
            "x": 0.5,
            "xanchor": "center",
            "y": 1.0 + (_TITLE if titles else 0) / (_ROW * rows * rows_high),
            "yanchor": "bottom",
        },
        plot_bgcolor="#ffffff",
        paper_bgcolor="#ffffff",
        hovermode="x",
        template="none",
    )
    return figure


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


def _range_of(panel: Panel) -> dict[str, Any]:
    """Return the range of a panel with limits: that of its curves; a double click shows all."""
    if not np.isfinite(panel.levels).any():
        return {}
    values = np.concatenate([values for _, values in panel.curves.values()])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = max(0.05 * (high - low), _FLAT)
    return {"range": [low - margin, high + margin]}


def _plain(label: str) -> str:
    """Return a label as the browser's plots write it: escaped, with indices in tags of theirs."""
    return re.sub(r"\$(\w)_(\w)\$", r"\1<sub>\2</sub>", html.escape(label)).replace("$", "")
