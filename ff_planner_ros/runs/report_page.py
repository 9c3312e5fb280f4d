"""A report as one HTML file that needs nothing else: neither server nor network.

What comes from a bag is put in by the standard library's element tree, which escapes it, and the
page forbids itself to load anything and to run any script but its own two.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from ff_planner_ros.analysis.tracking import Deviations, in_shown_units
from ff_planner_ros.bag.decoding import NANOSECONDS
from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.metrics import METRIC_BY_NAME, METRICS
from ff_planner_ros.runs.report import Report, ReportedPlan, ReportedRequest, clock_time
from ff_planner_ros.runs.report_plots import plan_plots, solve_time_plot

_NOTHING = "-"
_COLUMNS = (
    *("plan id", "door", "asked [UTC]", "status", "weights L, Θ", "duration [s]", "points"),
    *("joint path [rad]", "attitude [deg]", "clearance [mm]", "solve time [s]", "iterations"),
)
_TIMING_COLUMNS = (
    *("plan id", "asked", "taken up after [s]", "answered after [s]", "start after [s]"),
)


def save_page(report: Report, file: Path) -> None:
    """Write a report.

    Raises:
        OSError: It cannot be written.
    """
    page = "<!doctype html>\n" + tostring(_page(report), encoding="unicode", method="html") + "\n"
    # Half a surrogate, which JSON can bring in, is nothing that a file can hold.
    file.write_bytes(page.encode("utf-8", errors="replace"))


def _page(report: Report) -> Element:
    library, script, style = get_plotlyjs(), _resource("report.js"), _resource("report.css")
    allowed = " ".join(map(_hash, (library, script)))
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    head = _element(
        "head",
        _element("meta", charset="utf-8"),
        _element("meta", {"http-equiv": "Content-Security-Policy", "content": policy}),
        _element("meta", name="viewport", content="width=device-width"),
        _element("title", f"{report.title}: report of ff-planner"),
        _element("style", style),
        _element("script", library),
    )
    figures: list[Element] = []
    body = _element("body", *_sections(report, figures), *figures, _element("script", script))
    return _element("html", head, body, lang="en")


def _resource(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _sections(report: Report, figures: list[Element]) -> Iterator[Element]:
    yield _element("h1", f"Report: {report.title}")
    yield _pairs(report.facts)
    if report.notes:
        yield _list(report.notes, "notes")
    yield _element("h2", "Requests")
    attempts = any(r.metrics is not None and r.code != Status.SOLVED for r in report.requests)
    explained = " Where there is a *, of the best attempt, which is no plan." if attempts else ""
    yield _element("p", f"{report.counts}.{explained}")
    yield _requests(report.requests)
    yield from _timing(report.requests, figures)
    drawn = [(k, r, r.plan) for k, r in enumerate(report.requests) if r.plan is not None]
    if drawn:
        yield _element("h2", "Plans")
    with progress_bar("drawing", len(drawn), unit="plans", per_unit=1) as advance:
        for place, (number, request, plan) in enumerate(drawn):
            yield _plan(number, request, plan, place == 0, figures)
            advance(1)


def _requests(requests: Sequence[ReportedRequest]) -> Element:
    rows: list[Element] = []
    for number, request in enumerate(requests):
        rows.append(_row(_cells(number, request)))
        if request.code != Status.SOLVED:
            reason = _element("td", request.message, colspan=str(len(_COLUMNS)))
            rows.append(_element("tr", reason, {"class": "reason"}))
    return _table(_COLUMNS, rows)


def _cells(number: int, request: ReportedRequest) -> Iterator[Element | str]:
    name = request.plan_id or "(no id)"
    yield name if request.plan is None else _element("a", name, href=f"#plan-{number}")
    yield request.door
    yield _NOTHING if request.asked_ns is None else clock_time(request.asked_ns, with_date=False)
    kind = "solved" if request.code == Status.SOLVED else "refused"
    yield _element("span", _status(request), {"class": kind})
    yield _NOTHING if request.weights is None else "{:g}, {:g}".format(*request.weights)
    yield _NOTHING if request.duration is None else f"{request.duration:g}"
    yield _NOTHING if request.points is None else str(request.points)
    metrics, solver = request.metrics, request.solver
    # Without a plan these are the values of the best attempt, and marked.
    of_attempt = "" if request.code == Status.SOLVED else " *"
    for name in ("joint_path_length", "max_chaser_euler", "min_clearance"):
        if metrics is None:
            yield _NOTHING
        else:
            yield METRIC_BY_NAME[name].shown(getattr(metrics, name)) + of_attempt
    yield _NOTHING if request.solve_time is None else f"{request.solve_time:.3f}"
    yield _NOTHING if solver is None else str(solver.iterations)


def _status(request: ReportedRequest) -> str:
    if request.code is None:
        return "unanswered"
    try:
        return f"{request.code} {Status(request.code).name}"
    except ValueError:
        return f"{request.code} (unknown to this version)"


def _timing(requests: Sequence[ReportedRequest], figures: list[Element]) -> Iterator[Element]:
    timed = [request for request in requests if request.asked_ns is not None]
    times = [request.solve_time for request in requests if request.solve_time is not None]
    if not timed and len(times) < 2:
        return
    yield _element("h2", "Timing")
    if timed:
        yield _element("p", "By the node's clock, from the request on.")
        yield _table(_TIMING_COLUMNS, [_row(_times(request)) for request in timed])
    if len(times) > 1:
        yield _plot("solve-times", solve_time_plot(times), "Solve times of all answers.", figures)


def _times(request: ReportedRequest) -> Iterator[str]:
    asked_ns = request.asked_ns or 0
    yield request.plan_id or "(no id)"
    yield clock_time(asked_ns, with_date=False)
    for time_ns in (request.taken_up_ns, request.answered_ns, request.start_ns):
        yield _NOTHING if time_ns is None else f"{(time_ns - asked_ns) / NANOSECONDS:.3f}"


def _plan(
    number: int, request: ReportedRequest, plan: ReportedPlan, opened: bool, figures: list[Element]
) -> Element:
    attributes = {"id": f"plan-{number}"} | ({"open": "open"} if opened else {})
    parts = [_element("summary", request.plan_id)]
    if plan.remarks:
        parts.append(_list(plan.remarks, "remarks"))
    tables = [_element("div", _element("h3", "As planned"), _pairs(_metrics(request)))]
    if plan.deviations is not None:
        heading = _element("h3", "Measured against planned, at worst")
        tables.append(_element("div", heading, _deviations(plan.deviations)))
    parts.append(_element("div", *tables, {"class": "beside"}))
    parts += [
        _plot(f"plan-{number}-{name}", figure, caption, figures)
        for name, caption, figure in plan_plots(plan)
    ]
    return _element("details", *parts, attributes)


def _metrics(request: ReportedRequest) -> Iterator[tuple[str, str]]:
    metrics, solver = request.metrics, request.solver
    if request.start_ns is not None:
        yield "starts", clock_time(request.start_ns)
    if metrics is not None:
        for metric in METRICS:
            yield metric.label, metric.text(getattr(metrics, metric.name))
    if solver is not None:
        yield "solver", solver.stop_reason
        yield "search", f"{solver.starts} starts, {solver.rollouts} rollouts"


def _deviations(found: Deviations) -> Element:
    rows = [
        _row(
            (
                label,
                f"{values.max():.3g}",
                f"{found.time[values.argmax()]:.3f}",
                f"{values[-1]:.3g}",
            )
        )
        for label, values in in_shown_units(found)
    ]
    columns = (f"of {len(found.time)} states", "largest", "at t [s]", "at the last")
    return _table(columns, rows)


def _plot(name: str, figure: go.Figure, caption: str, figures: list[Element]) -> Element:
    """Return the place of a plot; its data lie at the end of the page and hold up nothing."""
    # Plotly writes "<" as an escape of JSON's: no name in it can end the script.
    text = figure.to_json()
    figures.append(_element("script", text, {"type": "application/json", "id": f"data-{name}"}))
    place = {
        "class": "plot",
        "id": name,
        "data-figure": f"data-{name}",
        "style": f"height: {figure.layout.height}px",
    }
    return _element("figure", _element("div", place), _element("figcaption", caption))


def _table(columns: Iterable[str], rows: Sequence[Element]) -> Element:
    head = _element("thead", _element("tr", *(_element("th", column) for column in columns)))
    table = _element("table", head, _element("tbody", *rows))
    return _element("div", table, {"class": "wide"})


def _row(cells: Iterable[Element | str]) -> Element:
    return _element("tr", *(_element("td", cell) for cell in cells))


def _pairs(pairs: Iterable[tuple[str, str]]) -> Element:
    rows = (_element("tr", _element("th", name), _element("td", value)) for name, value in pairs)
    return _element("table", _element("tbody", *rows), {"class": "facts"})


def _list(entries: Iterable[str], kind: str) -> Element:
    return _element("ul", *(_element("li", entry) for entry in entries), {"class": kind})


def _element(tag: str, *content: Element | str | dict[str, str], **attributes: str) -> Element:
    """Return an element of children, texts and, where Python has no name for one, attributes."""
    made = Element(tag, attributes)
    for item in content:
        if isinstance(item, dict):
            made.attrib.update(item)
        elif isinstance(item, str):
            made.text = (made.text or "") + item
        else:
            made.append(item)
    return made
