"""One HTML file that needs nothing else: neither server nor network.

Texts are put in by the standard library's element tree, which escapes them, and the page forbids
itself to load anything and to run any script but its own two.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

from plotly.offline import get_plotlyjs

from ff_planner_ros.runs.report_html import element

_SCRIPTS = ("report_plots.js", "report_clock.js")


def save_file(
    title: str, sections: Iterable[Element], figures: Sequence[Element], file: Path
) -> None:
    """Write a page.

    Args:
        title: Of the window.
        sections: What is seen, from top to bottom.
        figures: Data of the plots, as `report_html.plot` adds them; read when all sections are.
        file: What is there is replaced.

    Raises:
        OSError: It cannot be written.
    """
    page = _page(title, list(sections), figures)
    text = "<!doctype html>\n" + tostring(page, encoding="unicode", method="html") + "\n"
    # Half a surrogate, which JSON can bring in, is nothing that a file can hold.
    file.write_bytes(text.encode("utf-8", errors="replace"))


def _page(title: str, sections: Sequence[Element], figures: Sequence[Element]) -> Element:
    library, style = get_plotlyjs(), _resource("report.css")
    script = "".join(map(_resource, _SCRIPTS))
    allowed = " ".join(map(_hash, (library, script)))
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
        element("script", library),
    )
    body = element("body", *sections, *figures, element("script", script))
    return element("html", head, body, lang="en")


def _resource(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
