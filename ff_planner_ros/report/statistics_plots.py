"""The plots of many plans: success rates, and times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.common.arrays import Indices
from ff_planner_ros.report.statistics import Group, Rate, bins

# Okabe and Ito's, which colour-blind readers tell apart; with dashes for grey print.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES = ("solid", "dash", "dot", "dashdot")
_MOST_BINS = 12
# More points of a curve than a screen has columns for make the file large and show nothing; the
# numbers in the tables are of all.
_MOST_POINTS = 400
_TICKS = 10  # of the axis that counts answers, at whole numbers


def rate_plot(groups: Sequence[Group]) -> go.Figure:
    """Draw the success rate of each method."""
    rates = [group.solved for group in groups]
    bars = go.Bar(
        x=[group.name for group in groups],
        y=[100.0 * rate.share for rate in rates],
        error_y=_interval(rates),
        marker={"color": [_COLOURS[k % len(_COLOURS)] for k in range(len(groups))]},
    )
    return _laid_out(go.Figure(bars), "method", "solved [%]", {"range": [0.0, 105.0]})


def time_plot(groups: Sequence[Group]) -> go.Figure:
    """Draw which share of the cases is answered within a time."""
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
    """Draw how often which solve time [s] was needed."""
    figure = go.Figure(go.Histogram(x=np.array(times), marker={"color": PLANNED.colour}))
    ticks = {"dtick": -(-len(times) // _TICKS)}
    made = _laid_out(figure, "solve time [s]", "answers", ticks, height=260)
    return made.update_layout(xaxis={"rangemode": "tozero"}, bargap=0.05)


def varied_plot(name: str, column: str, groups: Sequence[Group]) -> go.Figure:
    """Draw the success rate of each method by a number that was varied."""
    figure = go.Figure()
    for place, group in enumerate(groups):
        found = bins(group.rows, column, _MOST_BINS)
        figure.add_scatter(
            x=[(one.lower + one.upper) / 2.0 for one in found],
            y=[100.0 * one.rate.share for one in found],
            error_y=_interval([one.rate for one in found]),
            name=group.name,
            mode="lines+markers",
            line=_line(place),
        )
    return _laid_out(figure, name, "solved [%]", {"range": [-5.0, 105.0]})


def evenly_spaced(count: int) -> Indices:
    """Return which rows of many are drawn, the first and the last among them."""
    return np.linspace(0, count - 1, min(count, _MOST_POINTS)).round().astype(int)


def _line(place: int) -> dict[str, str]:
    return {
        "color": _COLOURS[place % len(_COLOURS)],
        "dash": _DASHES[place % len(_DASHES)],
    }


def _interval(rates: Sequence[Rate]) -> dict[str, object]:
    ends = [rate.interval for rate in rates]
    return {
        "type": "data",
        "symmetric": False,
        "array": [100.0 * (e[1] - r.share) for e, r in zip(ends, rates, strict=True)],
        "arrayminus": [100.0 * (r.share - e[0]) for e, r in zip(ends, rates, strict=True)],
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
