"""The part of a report's page that shows one plan: in words, in numbers, in plots."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from ff_planner_ros.analysis.drawing.tracking import Deviations, in_shown_units
from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.planning.motion.metrics import METRICS
from ff_planner_ros.report.html import bullets, element, pairs, plot, row, table
from ff_planner_ros.report.plan_plots import plan_plots
from ff_planner_ros.report.plan_words import joint_table, obstacle_table, task_words, worst
from ff_planner_ros.report.run_report import ReportedPlan, ReportedRequest, clock_time


def plan_part(name: str, request: ReportedRequest, plan: ReportedPlan, opened: bool) -> Element:
    """Return the part of a page that shows one plan.

    Args:
        name: Identifies the plan on the page: links to this part go to `#plan-NAME`.
        opened: Whether the part is expanded at first.
    """
    attributes = {"id": f"plan-{name}"} | ({"open": "open"} if opened else {})
    picture, *plots = (
        plot(f"plan-{name}-{what}", figure, caption) for what, caption, figure in plan_plots(plan)
    )
    return element(
        "details",
        element("summary", request.plan_id or "(no id)"),
        *([bullets(plan.remarks, "remarks")] if plan.remarks else []),
        _clock(float(plan.motion.time[-1])),
        element("div", picture, element("div", *_at_worst(request, plan)), {"class": "picture"}),
        *plots,
        element("div", element("h3", "Asked"), pairs(task_words(plan))),
        element("div", *_in_numbers(request, plan), {"class": "beside"}),
        *_joints_and_obstacles(request, plan),
        attributes,
    )


def _at_worst(request: ReportedRequest, plan: ReportedPlan) -> Iterator[Element]:
    for method, motion in plan.motions.items():
        heading = element("h3", f"At its worst, as {method.label}")
        metrics = request.metrics if method is PLANNED else None
        yield element("div", heading, pairs(worst(plan, motion, metrics)))


def _in_numbers(request: ReportedRequest, plan: ReportedPlan) -> Iterator[Element]:
    yield element("div", element("h3", "Metrics, as planned"), pairs(_metrics(request)))
    if request.made_from:
        yield element("div", element("h3", "Made from"), pairs(request.made_from))
    if plan.deviations is not None:
        heading = element("h3", "Measured against planned, at worst")
        yield element("div", heading, _deviations(plan.deviations))


def _joints_and_obstacles(request: ReportedRequest, plan: ReportedPlan) -> Iterator[Element]:
    yield element("h3", "Joints, as planned")
    yield joint_table(plan.robot, plan.motion, request.metrics)
    if plan.obstacles:
        yield element("h3", "Obstacles, as planned")
        yield obstacle_table(plan.robot, plan.obstacles, plan.motion, plan.scene)


def _metrics(request: ReportedRequest) -> Iterator[tuple[str, str]]:
    metrics, solver = request.metrics, request.solver
    if request.start_ns is not None:
        yield "starts", clock_time(request.start_ns)
    if metrics is not None:
        for metric in METRICS:
            yield metric.label, metrics.told(metric.name)
    if solver is not None:
        yield "solver", solver.stop_reason
        # Of a robust plan the answer tells more.
        reason, _, more = request.message.partition(f"{solver.stop_reason}; ")
        if more and not reason:
            yield "robust", more
        yield "search", f"{solver.starts} starts, {solver.rollouts} rollouts"
    if request.guessed:
        yield "first guess", "the path of a library's plan; the search began with it"


def _deviations(found: Deviations) -> Element:
    rows = [
        row(
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
    return table(columns, rows)


def _clock(end: float) -> Element:
    """Return the controls of the time [s] that all plots of a plan show."""
    play = element("button", "▶", {"type": "button", "class": "play", "aria-label": "play"})
    slider = {"type": "range", "min": "0", "max": repr(end), "value": "0", "step": "any"}
    time = element("input", slider | {"aria-label": "time"})
    return element("div", play, time, element("output", "0.00 s"), {"class": "clock"})
