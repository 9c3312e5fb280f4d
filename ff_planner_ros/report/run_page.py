"""The page of a report: tables of requests, timing, and a part for each plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from ff_planner_ros.bag.progress_bar import progress_bar
from ff_planner_ros.bag.publications import Publication
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.report.html import NOTHING, bullets, element, pairs, plot, row, save_html, table
from ff_planner_ros.report.plan_section import plan_part
from ff_planner_ros.report.run_report import Report, ReportedPlan, ReportedRequest, clock_time
from ff_planner_ros.report.statistics_plots import solve_time_plot

_Part: TypeAlias = tuple[str, ReportedRequest, ReportedPlan]
# Of which the worst is told first.
_WORST = ("min_clearance", "min_self_clearance", "min_joint_margin", "max_chaser_rotation")
_ASKED = (
    "The robot at the start, its tool where the goal wants it, and what is in the way; red lines "
    "mark where they are nearest to each other."
)
_FEWEST_TIMES = 10  # of which a histogram tells more than their table
_COLUMNS = (
    *(
        "plan id",
        "interface",
        "asked [UTC]",
        "status",
        "weights L, Θ, T, h",
        "duration [s]",
        "points",
    ),
    *("joint path [rad]", "Euler angle [deg]", "rotation [deg]", "clearance [mm]"),
    *("solve time [s]", "iterations"),
)
_PUBLICATION_COLUMNS = (
    *("plan id", "asked by", "asked [UTC]", "status", "published"),
    *("age of the state [s]", "previous plan"),
)
_TIMING_COLUMNS = (
    *("plan id", "asked", "taken up after [s]", "answered after [s]", "start after [s]"),
)


def save_page(report: Report, file: Path, library: str = "") -> None:
    """Write the page of a report; library: see `save_html`.

    Raises:
        OSError: The file cannot be written.
    """
    save_html(report.title, _sections(report), file, library)


def _sections(report: Report) -> Iterator[Element]:
    yield element("h1", f"Report: {report.title}")
    yield from map(_verdict, _verdicts(report))
    if report.notes:
        yield bullets(report.notes, "notes")
    single = len(report.requests) == 1
    for number, request in enumerate(report.requests):
        if request.asked is not None:
            yield plot(f"asked-{number}", request.asked, _ASKED)
    if not single:
        yield from _all_requests(report)
        yield element("h2", "Plans")
    drawn = [part for k, request in enumerate(report.requests) for part in _parts(k, request)]
    with progress_bar("drawing", len(drawn), unit="plans", per_unit=1) as advance:
        for place, (name, request, plan) in enumerate(drawn):
            yield plan_part(name, request, plan, place == 0)
            advance(1)
    if single:
        yield from _all_requests(report)
    yield from _publications(report.publications)
    yield from _timing(report.requests)
    yield element("h2", "About this file")
    yield pairs(report.facts)


def _verdicts(report: Report) -> Iterator[tuple[str, str]]:
    """Yield the results, each a class in `report.css` and a sentence."""
    requests = report.requests
    if len(requests) != 1:
        yield "", f"{report.counts}."
    for request in requests if len(requests) == 1 else ():
        if request.code == Status.SOLVED:
            yield "solved", f"Solved. {'; '.join(_margins(request))}."
        else:
            yield "refused", f"{_status(request)}: {request.message}"
    plans = [one for one in requests if one.code == Status.SOLVED and one.metrics is not None]
    for name in _WORST if len(plans) > 1 else ():
        sign = 1.0 if name.startswith("min_") else -1.0
        found = [(sign * getattr(one.metrics, name), one) for one in plans]
        known = [(value, one) for value, one in found if np.isfinite(value)]
        if known:
            value, worst = min(known, key=lambda pair: pair[0])
            metric = METRIC_BY_NAME[name]
            label = f"least {metric.label}" if sign > 0.0 else metric.label
            yield "", f"{label.capitalize()}: {metric.text(sign * value)}, {worst.plan_id}."


def _margins(request: ReportedRequest) -> Iterator[str]:
    """Yield a plan's duration and the metrics of `_WORST`, in words."""
    metrics = request.metrics
    if request.duration is not None:
        yield f"It takes {request.duration:.4g} s"
    for name in _WORST if metrics is not None else ():
        metric, value = METRIC_BY_NAME[name], getattr(metrics, name)
        if np.isfinite(value):
            yield f"{metric.label} {metric.text(value)}"


def _verdict(told: tuple[str, str]) -> Element:
    kind, words = told
    return element("p", words, {"class": f"verdict {kind}".rstrip()})


def _parts(number: int, request: ReportedRequest) -> Iterator[_Part]:
    """Yield name, request and plan of each phase of a request that is drawn."""
    if request.plan is None:
        return
    if not request.then:
        yield str(number), request, request.plan
        return
    for phase, plan in enumerate((request.plan, *request.then), start=1):
        # The metrics of a sequence are of the whole.
        called = f"{request.plan_id}, phase {phase}"
        of_phase = replace(request, plan_id=called, metrics=None, solver=None)
        yield f"{number}" if phase == 1 else f"{number}-{phase}", of_phase, plan


def _all_requests(report: Report) -> Iterator[Element]:
    yield element("h2", "Requests")
    attempts = any(r.metrics is not None and r.code != Status.SOLVED for r in report.requests)
    explained = "Where there is a *, of the best attempt, which is no plan." if attempts else ""
    if explained:
        yield element("p", explained)
    yield _requests(report.requests)


def _requests(requests: Sequence[ReportedRequest]) -> Element:
    rows: list[Element] = []
    for number, request in enumerate(requests):
        rows.append(row(_cells(number, request)))
        if request.code != Status.SOLVED:
            reason = element("td", request.message, colspan=str(len(_COLUMNS)))
            rows.append(element("tr", reason, {"class": "reason"}))
    return table(_COLUMNS, rows)


def _cells(number: int, request: ReportedRequest) -> Iterator[Element | str]:
    name = request.plan_id or "(no id)"
    yield name if request.plan is None else element("a", name, href=f"#plan-{number}")
    yield request.door
    yield NOTHING if request.asked_ns is None else clock_time(request.asked_ns, with_date=False)
    kind = "solved" if request.code == Status.SOLVED else "refused"
    yield element("span", _status(request), {"class": kind})
    weights = None if request.weights is None else ", ".join(map("{:g}".format, request.weights))
    yield weights or NOTHING
    yield _duration(request)
    yield NOTHING if request.points is None else str(request.points)
    metrics, solver = request.metrics, request.solver
    # Without a plan these are the values of the best attempt, and marked.
    of_attempt = "" if request.code == Status.SOLVED else " *"
    for name in ("joint_path_length", "max_chaser_euler", "max_chaser_rotation", "min_clearance"):
        if metrics is None:
            yield NOTHING
        else:
            yield METRIC_BY_NAME[name].shown(getattr(metrics, name)) + of_attempt
    yield NOTHING if request.solve_time is None else f"{request.solve_time:.3f}"
    yield NOTHING if solver is None else str(solver.iterations)


def _publications(asked: Sequence[Publication]) -> Iterator[Element]:
    """Yield heading and table of the calls of `~/publish_plan`."""
    if not asked:
        return
    yield element("h2", "publish_plan")
    rows = list[Element]()
    for one in asked:
        kind = "solved" if one.published else "refused"
        cells = (
            one.plan_id or "(no id)",
            one.requester or NOTHING,
            clock_time(one.asked_ns, with_date=False),
            element("span", one.status, {"class": kind}),
            "yes" if one.published else "no",
            NOTHING if one.state_age_s is None else f"{one.state_age_s:.3f}",
            one.previous_plan_id or NOTHING,
        )
        rows.append(row(cells))
        if not one.published:
            reason = element("td", one.message, colspan=str(len(_PUBLICATION_COLUMNS)))
            rows.append(element("tr", reason, {"class": "reason"}))
    yield table(_PUBLICATION_COLUMNS, rows)


def _duration(request: ReportedRequest) -> str:
    given = NOTHING if request.duration is None else f"{request.duration:g}"
    if request.durations is None:
        return given
    window = "{:g} to {:g}".format(*request.durations)
    return window if request.duration is None else f"{request.duration:.3f} of {window}"


def _status(request: ReportedRequest) -> str:
    if request.code is None:
        return "unanswered"
    try:
        return f"{request.code} {Status(request.code).name}"
    except ValueError:
        return f"{request.code} (unknown to this version)"


def _timing(requests: Sequence[ReportedRequest]) -> Iterator[Element]:
    timed = [request for request in requests if request.asked_ns is not None]
    times = [request.solve_time for request in requests if request.solve_time is not None]
    if not timed and len(times) < _FEWEST_TIMES:
        return
    yield element("h2", "Timing")
    if timed:
        yield element("p", "By the node's clock, from the request on.")
        yield table(_TIMING_COLUMNS, [row(_times(request)) for request in timed])
    if len(times) >= _FEWEST_TIMES:
        yield plot("solve-times", solve_time_plot(times), "Solve times of all answers.")


def _times(request: ReportedRequest) -> Iterator[str]:
    asked_ns = request.asked_ns or 0
    yield request.plan_id or "(no id)"
    yield clock_time(asked_ns, with_date=False)
    for time_ns in (request.received_ns, request.answered_ns, request.start_ns):
        yield NOTHING if time_ns is None else f"{(time_ns - asked_ns) / NANOSECONDS:.3f}"
