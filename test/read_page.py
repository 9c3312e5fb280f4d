"""A report's page as a test reads it."""

from __future__ import annotations

import base64
import json
from html.parser import HTMLParser
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array


class Page(HTMLParser):
    """What a page holds: rows of its tables, scripts, plots, and everything that it refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.data: dict[str, Any] = {}
        self.scripts: list[str] = []
        self.plots: dict[str, str] = {}
        self.referred: list[str] = []
        self.tags: set[str] = set()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.policy = self.words = ""
        self._open: tuple[str, dict[str, str]] = ("", {})
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self._open = (tag, found)
        self.tags.add(tag)
        self.elements.append((tag, found))
        self.referred += [found[name] for name in ("src", "href", "data") if name in found]
        assert not [name for name in found if name.startswith("on")]
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy = found["content"]
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th") and self.rows:
            self.rows[-1].append("")
        if found.get("class") == "plot":
            self.plots[found["id"]] = found["data-figure"]

    def handle_endtag(self, tag: str) -> None:
        if tag == self._open[0]:
            self._open = ("", {})

    def handle_data(self, data: str) -> None:
        tag, attributes = self._open
        if tag == "script" and attributes.get("type") == "application/json":
            assert "<" not in data
            self.data[attributes["id"]] = json.loads(data)
        elif tag == "script":
            self.scripts.append(data)
        elif tag != "style":
            self.words += data
            if self.rows and self.rows[-1]:
                self.rows[-1][-1] += data

    def row(self, start: str) -> list[str]:
        """The first row whose first cell is this."""
        return next(row for row in self.rows if row and row[0] == start)

    def plot(self, name: str) -> dict[str, Any]:
        return dict(self.data[self.plots[name]])

    def curves(self, name: str, method: str) -> list[tuple[Array, Array]]:
        traces = [trace for trace in self.plot(name)["data"] if trace["name"] == method]
        return [(numbers(trace["x"]), numbers(trace["y"])) for trace in traces]


def numbers(values: Any) -> Array:
    """An array as plotly writes it: a list, or the bytes of one."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"]).astype(float)
    return np.array(values, float)
