"""The elements that a report's page is made of.

The standard library's element tree escapes every text: what comes from a bag is never a tag.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element

import plotly.graph_objects as go


def element(tag: str, *content: Element | str | dict[str, str], **attributes: str) -> Element:
    """Return an element of children, texts and, where Python has no name for one, attributes."""
    made, last = Element(tag, attributes), None
    for item in content:
        if isinstance(item, dict):
            made.attrib.update(item)
        elif not isinstance(item, str):
            made.append(item)
            last = item
        elif last is None:
            made.text = (made.text or "") + item
        else:
            last.tail = (last.tail or "") + item
    return made


def table(columns: Iterable[str], rows: Sequence[Element]) -> Element:
    """Return a table; on a narrow screen each cell says by itself what column it is of."""
    columns = list(columns)
    for made in rows:
        for column, cell in zip(columns, made.iter("td"), strict=False):
            cell.set("data-column", column)
    head = element("thead", element("tr", *(element("th", column) for column in columns)))
    made = element("table", head, element("tbody", *rows))
    return element("div", made, {"class": "wide"})


def row(cells: Iterable[Element | str]) -> Element:
    """Return a row of a table."""
    return element("tr", *(element("td", cell) for cell in cells))


def pairs(found: Iterable[tuple[str, Element | str]]) -> Element:
    """Return a table of names and what they are."""
    rows = (element("tr", element("th", name), element("td", value)) for name, value in found)
    return element("table", element("tbody", *rows), {"class": "facts"})


def bullets(entries: Iterable[str], kind: str) -> Element:
    """Return a list of a kind that the style knows."""
    return element("ul", *(element("li", entry) for entry in entries), {"class": kind})


def when(time: float) -> Element:
    """Return a time [s] of a plan; a click on it moves the plan's plots there."""
    words = {"type": "button", "class": "when", "data-time": repr(float(time))}
    return element("button", f"{time:.2f} s", words)


def plot(name: str, figure: go.Figure, caption: str, figures: list[Element]) -> Element:
    """Return the place of a plot; its data lie at the end of the page and hold up nothing."""
    # Plotly writes "<" as an escape of JSON's: no name in it can end the script.
    text = figure.to_json()
    figures.append(element("script", text, {"type": "application/json", "id": f"data-{name}"}))
    place = {"class": "plot", "id": name, "data-figure": f"data-{name}"}
    return element("figure", element("div", place), element("figcaption", caption))
