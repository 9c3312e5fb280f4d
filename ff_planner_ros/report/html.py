"""Elements of an HTML page, and the file that holds it: it needs neither server nor network.

The standard library's element tree escapes every text: what comes from a bag is never a tag. The
page's Content-Security-Policy allows no script but its own two, and to load nothing else.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

NOTHING = "-"  # in a cell whose value is not known
LIBRARY = "plotly.js"  # a file for pages that lie together, each of which would be 5 MB larger

_SCRIPTS = ("plots.js", "clock.js", "explorer.js")


def element(tag: str, *content: Element | str | dict[str, str], **attributes: str) -> Element:
    """Return an element of children and texts, in order; dictionaries add attributes."""
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
    """Return a table; each cell carries its column's name, which narrow screens show."""
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
    """Return a table of names and values."""
    rows = (element("tr", element("th", name), element("td", value)) for name, value in found)
    return element("table", element("tbody", *rows), {"class": "facts"})


def bullets(entries: Iterable[str], kind: str) -> Element:
    """Return a bullet list; kind: its class in `report.css`."""
    return element("ul", *(element("li", entry) for entry in entries), {"class": kind})


def when(time: float) -> Element:
    """Return a button of a time [s]; a click on it moves the plan's plots there."""
    words = {"type": "button", "class": "when", "data-time": repr(float(time))}
    return element("button", f"{time:.2f} s", words)


def plot(name: str, figure: go.Figure, caption: str) -> Element:
    """Return the element of a plot with its data and caption; name: its id on the page."""
    # Plotly writes "<" as an escape of JSON's: no name in it can end the script.
    text = figure.to_json()
    data = element("script", text, {"type": "application/json", "id": f"data-{name}"})
    place = {"class": "plot", "id": name, "data-figure": f"data-{name}"}
    return element("figure", element("div", place), element("figcaption", caption), data)


def save_library(file: Path) -> None:
    """Write plotly.js into a file, for pages that load it from there.

    Raises:
        OSError: The file cannot be written.
    """
    file.write_text(get_plotlyjs(), encoding="utf-8")


def save_html(title: str, sections: Iterable[Element], file: Path, library: str = "") -> None:
    """Write a page of sections, from top to bottom; an existing file is replaced.

    Args:
        library: Path of plotly.js relative to the file; empty: the page contains it.

    Raises:
        OSError: The file cannot be written.
    """
    page = _page(title, sections, library)
    text = "<!doctype html>\n" + tostring(page, encoding="unicode", method="html") + "\n"
    # An unpaired surrogate, which JSON can bring in, cannot be encoded.
    file.write_bytes(text.encode("utf-8", errors="replace"))


def _page(title: str, sections: Iterable[Element], library: str) -> Element:
    plotly = element("script", src=library) if library else element("script", get_plotlyjs())
    style, script = _resource("report.css"), "".join(map(_resource, _SCRIPTS))
    allowed = "'self'" if library else _hash(get_plotlyjs())
    allowed += f" {_hash(script)}"
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", {"http-equiv": "Content-Security-Policy", "content": policy}),
        element("meta", name="viewport", content="width=device-width"),
        element("title", f"{title}: report of ff-planner"),
        element("style", style),
        plotly,
    )
    body = element("body", *sections)
    for figure in list(body.iter("figure")):
        for data in figure.findall("script"):  # at the end of the page they hold up nothing
            figure.remove(data)
            body.append(data)
    body.append(element("script", script))
    return element("html", head, body, lang="en")


def _resource(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
