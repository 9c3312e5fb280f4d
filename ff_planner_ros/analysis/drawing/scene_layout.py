"""Axes, camera and controls of the scene, and its page."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

_FRAME_DURATION = 100  # [ms] on the screen
# How light falls on surfaces: sides differ, and nothing is black.
LIT = {"ambient": 0.65, "diffuse": 0.7, "specular": 0.15, "roughness": 0.6, "fresnel": 0.1}
_CAMERA = {"eye": {"x": -0.9, "y": -1.75, "z": 0.8}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}

_PAGE = (
    '<!doctype html><html><head><meta charset="utf-8"><title>{title}</title>'
    '<meta name="viewport" content="width=device-width">'
    "<style>body {{margin: 0}}</style></head><body>{element}</body></html>\n"
)


def save_page(figure: go.Figure, title: str, path: Path) -> None:
    """Write a figure as one HTML file that needs nothing else."""
    # The name of the scene's element is fixed: the same figure gives the same file.
    element = figure.to_html(
        full_html=False,
        include_plotlyjs=True,
        auto_play=False,
        default_height="100vh",
        div_id="scene",
        config={"displaylogo": False},
    )
    path.write_text(_PAGE.format(title=html.escape(title), element=element), "utf-8")


def lay_out(figure: go.Figure) -> None:
    """Fix axes and camera, so that only the robot moves."""
    drawn = [*figure.data, *(trace for frame in figure.frames for trace in frame.data)]
    points = np.hstack([[np.asarray(trace[axis], float) for axis in "xyz"] for trace in drawn])
    low, high = np.nanmin(points, axis=1), np.nanmax(points, axis=1)
    margin = 0.05 * (high - low).max()
    spans = high - low + 2 * margin
    axes = {
        f"{axis}axis": {
            "title": {"text": f"{axis} [m]"},
            "range": [low[k] - margin, high[k] + margin],
            "backgroundcolor": "#f7f7f7",
            "gridcolor": "#dddddd",
            "zerolinecolor": "#bbbbbb",
        }
        for k, axis in enumerate("xyz")
    }
    ratio = dict(zip("xyz", (spans / np.cbrt(spans.prod())).tolist(), strict=True))
    figure.update_layout(
        scene={
            **axes,
            "aspectmode": "manual",
            "aspectratio": ratio,
            "camera": _CAMERA,
            "uirevision": "kept",
        },
        uirevision="kept",
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"x": 0.01, "y": 0.99, "bgcolor": "rgba(255, 255, 255, 0.7)"},
    )


def add_turns(figure: go.Figure, robots: Mapping[str, Sequence[int]], first: str) -> None:
    """Add buttons that show one of several robots at a time.

    Args:
        robots: Trace indices of each robot, by its name.
        first: Name of the robot that is shown first.
    """
    every = [trace for traces in robots.values() for trace in traces]
    figure.update_layout(
        updatemenus=[
            {
                "type": "buttons",
                "direction": "right",
                "x": 0.99,
                "y": 0.99,
                "xanchor": "right",
                "yanchor": "top",
                "active": list(robots).index(first),
                "buttons": [
                    {
                        "label": html.escape(name),
                        "method": "restyle",
                        "args": [{"visible": [trace in traces for trace in every]}, every],
                    }
                    for name, traces in robots.items()
                ],
            }
        ]
    )


def add_controls(figure: go.Figure) -> None:
    """Add a slider of the time, and buttons to play and to stop, below the scene."""
    play = {"frame": {"duration": _FRAME_DURATION, "redraw": True}, "fromcurrent": True}
    stop = {"frame": {"duration": 0, "redraw": True}, "mode": "immediate"}
    figure.update_layout(
        scene_domain={"y": [0.14, 1.0]},
        updatemenus=[
            *figure.layout.updatemenus,
            {
                "type": "buttons",
                "direction": "left",
                "x": 0.01,
                "y": 0.12,
                "xanchor": "left",
                "yanchor": "top",
                "buttons": [
                    {"label": "▶", "method": "animate", "args": [None, play]},
                    {"label": "❚❚", "method": "animate", "args": [[None], stop]},
                ],
            },
        ],
        sliders=[
            {
                "x": 0.12,
                "len": 0.86,
                "y": 0.14,
                "currentvalue": {"prefix": "time ", "suffix": " s"},
                "steps": [
                    {"label": frame.name, "method": "animate", "args": [[frame.name], stop]}
                    for frame in figure.frames
                ],
            }
        ],
    )
