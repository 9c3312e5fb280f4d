"""The plots of many answers: their times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.common.arrays import Indices
from ff_planner_ros.report.statistics import Group

# Okabe and Ito's, which colour-blind readers tell apart; with dashes for grey print.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES = ("solid", "dash", "dot", "dashdot")
# More points of a curve than a screen has columns for make the file large and show nothing; the
# numbers in the tables are of all.
_MOST_POINTS = 400
_TICKS = 10  # of the axis that counts answers, at whole numbers


def time_plot(groups: Sequence[Group]) -> go.Figure:
    """Draw the share of cases answered within a solve time [s], a curve for each group."""
    figure = go.Figure()
    for place, group in enumerate(groups):
        times = np.sort(group.values("solve_time", solved_only=False))
        if len(times):
            shown = evenly_spaced(len(times))
            figure.add_scatter(
                x=times[shown],
                y=100.0 * (shown + 1) / len(times),
                name=group.name,
                mode="lines",
                line={"shape": "hv", **_line(place)},
            )
    made = _laid_out(figure, "time [s]", "answered [%]", {"range": [0.0, 105.0]})
    return made.update_xaxes(type="log")


def solve_time_plot(times: Sequence[float]) -> go.Figure:
    """Draw a histogram of solve times [s]."""
    figure = go.Figure(go.Histogram(x=np.array(times), marker={"color": PLANNED.colour}))
    ticks = {"dtick": -(-len(times) // _TICKS)}
    made = _laid_out(figure, "solve time [s]", "answers", ticks, height=260)
    return made.update_layout(xaxis={"rangemode": "tozero"}, bargap=0.05)


def evenly_spaced(count: int, most: int = _MOST_POINTS) -> Indices:
    """Return up to `most` evenly spaced indices below `count`, the first and the last included."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int)


def _line(place: int) -> dict[str, str]:
    return {
        "color": _COLOURS[place % len(_COLOURS)],
        "dash": _DASHES[place % len(_DASHES)],
    }


def _laid_out(
    figure: go.Figure, across: str, up: str, up_more: Mapping[str, object], height: int = 300
) -> go.Figure:
    return figure.update_layout(
        height=height,
        margin={"l": 60, "r": 20, "t": 20, "b": 50},
        xaxis={"title": {"text": across}},
        yaxis={"title": {"text": up}, **up_more},
        template="none",
    )
