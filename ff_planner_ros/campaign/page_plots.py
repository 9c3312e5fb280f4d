"""The figures of a campaign's report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from ff_planner_ros.campaign.statistics import Group, Rate, bins

# Okabe and Ito's, which colour-blind readers tell apart; with dashes for grey print.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES = ("solid", "dash", "dot", "dashdot")
_MOST_BINS = 12
_MOST_POINTS = 400  # of a curve; more than a screen has columns for


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
            shown = np.unique(np.linspace(0, len(times) - 1, _MOST_POINTS).round().astype(int))
            figure.add_scatter(
                x=times[shown],
                y=100.0 * (shown + 1) / len(times),
                name=group.name,
                mode="lines",
                line={"shape": "hv", **_line(place)},
            )
    made = _laid_out(figure, "time [s]", "answered [%]", {"range": [0.0, 105.0]})
    return made.update_xaxes(type="log")


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


def _laid_out(figure: go.Figure, across: str, up: str, up_more: dict[str, object]) -> go.Figure:
    return figure.update_layout(
        height=300,
        margin={"l": 60, "r": 20, "t": 20, "b": 50},
        xaxis={"title": {"text": across}},
        yaxis={"title": {"text": up}, **up_more},
        template="none",
    )
