"""The report of a bag: its requests, and its plans beside what was measured while they ran."""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ff_planner_ros.analysis.drawing.tracking import deviations, measured_motion
from ff_planner_ros.bag.exchanges import WITHOUT_EXCHANGES, Exchange, exchange_count, exchanges
from ff_planner_ros.bag.provenance import PROVENANCE
from ff_planner_ros.bag.publications import publications
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.messages.plans import (
    metrics_from_message,
    plan_of_task,
    solver_report_from_message,
)
from ff_planner_ros.parameters import NodeParameters, default_values
from ff_planner_ros.parameters.values import flattened, parameters_of
from ff_planner_ros.planning.problem.problem import Objective, lasting
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.report.from_topics import PublishedMotion, published_motions
from ff_planner_ros.report.run_report import (
    Report,
    ReportedPlan,
    ReportedRequest,
    clock_time,
    reported_plan,
    robot_facts,
)
from ff_planner_ros.robot.model import Robot

if TYPE_CHECKING:  # it reads measurements as the node does, by ROS
    from ff_planner_ros.runs.measured import Window

_PARAMETERS = "parameters.yaml"
_PUBLISHED = "ff_planner_msgs/msg/PublishedPlan"
_PUBLISHED_ALONE = "It was published on a topic: twists of the chaser are differences of its path."
WITHOUT_ROS = "without ROS nothing measured is compared with the plans"
_UNPUBLISHED = "It was asked for with plan_only, and never published: nobody executed it."


def report_of_bag(path: Path, most_plans: int) -> Report:
    """Return the report of a run, the last `most_plans` of its plans drawn.

    Raises:
        BagError: The bag cannot be read at all.
    """
    with open_bag(path) as bag:
        return _report_of_bag(bag, most_plans)


@dataclass(eq=False)
class _Row:
    """A request of the bag, as far as the page needs it."""

    request: ReportedRequest
    planner: str  # its namespace
    frame: str = ""  # inertial frame of the plan
    spans: Sequence[tuple[int, int]] = ()  # first and last point of each phase's plan [ns]
    exchange: Exchange | None = None  # of a plan to draw
    published: PublishedMotion | None = None  # to draw, in a bag without exchanges


def _report_of_bag(bag: Bag, most_plans: int) -> Report:
    notes: list[str] = []
    parameters = _parameters(bag, notes)
    rows, drawn = list[_Row](), deque[_Row]()
    for exchange in exchanges(bag):
        try:
            rows.append(_row(exchange))
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            notes.append(f"{exchange.plan_id or 'an answer'} is left out, it is damaged: {error}")
            continue
        if rows[-1].spans:
            drawn.append(rows[-1])
            rows[-1].exchange = exchange
        elif rows[-1].request.code == Status.SOLVED:
            notes.append(f"{exchange.plan_id or 'an answer'} is not drawn: it holds no plan")
        if len(drawn) > most_plans:
            drawn.popleft().exchange = None  # a long run's plans do not fit the memory
    if not exchange_count(bag):
        notes.append(f"nothing of it can be planned again: {WITHOUT_EXCHANGES}")
        drawn = deque(map(_published_row, published_motions(bag)), most_plans)
        rows += drawn
    solved = sum(bool(row.spans) for row in rows)
    if len(drawn) < solved:
        notes.append(f"of {solved} plans the last {len(drawn)} are drawn; --plans N draws more")
    unpublished = never_published(bag, rows)
    rows.sort(key=lambda row: row.request.asked_ns or row.request.answered_ns or 0)
    robot = _draw(bag, parameters, rows, unpublished, notes)
    facts = (*_bag_facts(bag), *(robot_facts(robot) if robot else ()))
    requests = tuple(row.request for row in rows)
    return Report(bag.path.name, facts, (*bag.notes, *notes), requests, tuple(publications(bag)))


def _draw(
    bag: Bag,
    parameters: NodeParameters | None,
    rows: Sequence[_Row],
    unpublished: Container[str],
    notes: list[str],
) -> Robot | None:
    """Add the plans to draw, one a phase, to their requests; what cannot be drawn makes a note.

    Returns:
        The robot of the last one.
    """
    plans = dict[int, list[ReportedPlan]]()
    robot: Robot | None = None
    for number, row in enumerate(rows):
        if row.published is not None:
            robot = row.published.robot
            plan = reported_plan(robot, row.published.motion, None, Scene())
            plans[number] = [replace(plan, remarks=(*plan.remarks, _PUBLISHED_ALONE))]
        if row.exchange is None:
            continue
        try:
            robot, plans[number] = _phases(row.exchange)
        except FfPlannerError as error:
            notes.append(f"{row.request.plan_id or 'an answer'} is not drawn: {error}")
            continue
        if row.request.plan_id in unpublished:
            remarked = [replace(p, remarks=(*p.remarks, _UNPUBLISHED)) for p in plans[number]]
            plans[number] = remarked
    if robot is not None and find_spec("ff_planner_msgs") is None:
        notes.append(WITHOUT_ROS)
    elif robot is not None:
        executed = [row for row in rows if row.spans and row.request.plan_id not in unpublished]
        later = {k: executed[executed.index(rows[k]) :] for k in plans if rows[k] in executed}
        _compare(bag, robot, parameters, plans, {k: _windows(of) for k, of in later.items()})
    for number, (first, *then) in plans.items():
        rows[number].request = replace(rows[number].request, plan=first, then=tuple(then))
    return robot


def _compare(
    bag: Bag,
    robot: Robot,
    parameters: NodeParameters | None,
    plans: dict[int, list[ReportedPlan]],
    windows: Mapping[int, Sequence[Window]],
) -> None:
    """Add what was measured to the plans that have windows; None: the bag lacks `parameters`."""
    if parameters is not None:
        from ff_planner_ros.runs.measured import fill_windows

        fill_windows(bag, robot, parameters, [one for of_one in windows.values() for one in of_one])
    for number, of_one in windows.items():
        pairs = zip(plans[number], of_one, strict=True)
        plans[number] = [_with_measured(plan, window, parameters) for plan, window in pairs]


def _parameters(bag: Bag, notes: list[str]) -> NodeParameters | None:
    """Return the node's parameters; None: they are not in the bag, which makes a note."""
    try:
        written = bag.attachments[_PARAMETERS].decode()
        values = flattened(yaml_document(written, _PARAMETERS, "damaged"))
        known = default_values()
        return parameters_of({**known, **{k: v for k, v in values.items() if k in known}})
    except KeyError:
        if "node" in bag.metadata.get(PROVENANCE, {}):
            notes.append(f"no {_PARAMETERS} is attached: nothing measured is compared")
    except (InvalidInput, TypeError, ValueError, AttributeError) as error:
        notes.append(f"{_PARAMETERS} is damaged, and nothing measured is compared: {error}")
    return None


def _row(exchange: Exchange) -> _Row:
    request = reported_request(exchange)
    if request.start_ns is None:
        return _Row(request, exchange.planner)
    frame = str(value_at(exchange.answer, "plans[0].chaser_path.header.frame_id", ""))
    return _Row(request, exchange.planner, frame, [_span(one) for one in exchange.answer.plans])


def _published_row(found: PublishedMotion) -> _Row:
    end_ns = found.start_ns + round(float(found.motion.time[-1]) * NANOSECONDS)
    request = ReportedRequest(
        plan_id="",
        door=found.topic,
        start_ns=found.start_ns,
        message="no answer is in the bag",
        points=len(found.motion.time),
    )
    planner, span = found.topic.rpartition("/")[0], (found.start_ns, end_ns)
    return _Row(request, planner, found.frame, [span], published=found)


def reported_request(exchange: Exchange) -> ReportedRequest:
    """Return the row of a request and its answer, without the plans to draw."""
    request, answer = exchange.request, exchange.answer
    found = ReportedRequest(
        plan_id=exchange.plan_id,
        door=exchange.interface,
        message="no answer is in the bag",
        asked_ns=exchange.asked_ns or None,
        answered_ns=exchange.answered_ns or None,
    )
    if request is not None:
        weights = tuple(value_at(request.objective, one.name) for one in fields(Objective))
        found = replace(found, weights=weights)
        if request.duration_max:
            found = replace(found, durations=(request.duration, request.duration_max))
        else:
            # What goes on from a running plan keeps that plan's goal, and asks for no duration.
            found = replace(found, duration=request.duration or None)
    if answer is None:
        return found
    is_chosen = found.durations is not None or found.duration is None
    if is_chosen and answer.status.code == Status.SOLVED:
        found = replace(found, duration=value_at(answer, "plans[0].duration", 0.0) or None)
    found = replace(
        found,
        received_ns=nanoseconds(answer.inputs.received_stamp) or None,
        code=answer.status.code,
        message=answer.status.message,
        solve_time=answer.solver.solve_time or None,
        guessed=len(answer.inputs.first_guess) > 0,
        made_from=tuple(_made_from(answer.inputs)),
    )
    if len(answer.metrics):
        metrics = metrics_from_message(answer.metrics[0])
        solver = solver_report_from_message(answer.solver)
        found = replace(found, metrics=metrics, solver=solver)
    points = value_at(answer, "plans[0].joint_trajectory.points", ())
    if answer.status.code == Status.SOLVED and len(points):
        start_ns, _ = _span(answer.plans[0])
        found = replace(found, start_ns=start_ns, points=len(points))
    return found


def _made_from(inputs: Any) -> Iterator[tuple[str, str]]:
    """Yield age and source of each input that an answer names, when the request was read."""
    read_ns = nanoseconds(inputs.received_stamp)
    for name in ("state", "joint_states", "obstacles", "target_body"):
        if stamp_ns := nanoseconds(value_at(inputs, f"{name}_stamp")):
            source = str(value_at(inputs, f"{name}_source", ""))
            age = f"{(read_ns - stamp_ns) / NANOSECONDS:.3f} s old"
            yield name.replace("_", " "), f"{age}, {source}" if source else age


def never_published(bag: Bag, rows: Sequence[_Row]) -> frozenset[str]:
    """Return the ids of the plans that were requested with `plan_only` and never published.

    Raises:
        BagError: The disk fails.
    """
    waiting = {
        row.request.plan_id
        for row in rows
        if row.exchange is not None and value_at(row.exchange.request, "plan_only", False)
    }
    if waiting:  # or else there is no need to look through the bag
        messages = bag.decoded(_PUBLISHED)
        waiting -= {str(value_at(message, "plan_id", "")) for _, message in messages}
    return frozenset(waiting)


def _phases(exchange: Exchange) -> tuple[Robot, list[ReportedPlan]]:
    """Return the robot, and the plan of each phase with its scene."""
    task = exchange.planned_task()
    plan = plan_of_task(task, exchange.answer)
    drawn = list[ReportedPlan]()
    for of_phase, one in phase_tasks(task, plan):
        problem = lasting(of_phase.problem, one.duration)
        scene, obstacles = scene_of(problem), tuple(problem.obstacles)
        drawn.append(reported_plan(problem.robot, one.trajectory, obstacles, scene, one.wheels))
    return task.problem.robot, drawn


def _windows(executed: Sequence[_Row]) -> list[Window]:
    """Return the time window of each phase of a plan, cut where the next plan starts."""
    from ff_planner_ros.runs.measured import Window

    first, *others = executed
    later = [row.spans[0][0] for row in others if row.planner == first.planner]
    return [
        Window(first.planner, first.frame, start, min([end, *later])) for start, end in first.spans
    ]


def _span(plan: Any) -> tuple[int, int]:
    """Return the times of a plan's first and last point [ns]."""
    motion = plan.joint_trajectory
    start_ns = nanoseconds(motion.header.stamp)
    return start_ns, start_ns + nanoseconds(motion.points[-1].time_from_start)


def _with_measured(
    plan: ReportedPlan, window: Window, parameters: NodeParameters | None
) -> ReportedPlan:
    remarks = list(plan.remarks)
    if window.unusable:
        remarks.append(
            f"{len(window.unusable)} measurements could not be used; the first: "
            f"{window.unusable[0]}"
        )
    if len(window.states) < 2:  # a bag of the command line holds the start alone
        many = "no" if not window.states else "but one"
        remarks.append(f"The bag holds {many} measured state while it ran.")
        return replace(plan, remarks=tuple(remarks))
    if window.left_out:
        remarks.append(
            f"Of {window.left_out + len(window.states)} measured states {len(window.states)} are "
            "compared, evenly in time."
        )
    stamps = np.array(sorted(window.states))
    time = (stamps - window.start_ns) / NANOSECONDS
    # A plan's times are counted in nanoseconds, too: the last may be beyond its end by rounding.
    time = np.clip(time, plan.motion.time[0], plan.motion.time[-1])
    measured = measured_motion(plan.robot, time, [window.states[s] for s in stamps.tolist()])
    of_joints = plan.robot.joint_weights, plan.robot.continuous
    found = deviations(plan.motion, measured, *of_joints)
    worst = float(found.joint_position.max())
    tolerance = parameters.tracking.max_joint_position if parameters is not None else np.inf
    if worst > tolerance:
        remarks.append(
            f"A joint was {worst:.3g} rad off the plan, more than tracking.max_joint_position, "
            f"{tolerance:g} rad: it was not executed, or not to its end."
        )
    return replace(plan, measured=measured, deviations=found, remarks=tuple(remarks))


def _bag_facts(bag: Bag) -> list[tuple[str, str]]:
    seconds = (bag.end_ns - bag.start_ns) / NANOSECONDS
    size = sum(file.stat().st_size for file in bag.files)
    facts = [
        ("bag", str(bag.path)),
        ("files", f"{len(bag.files)}, {size / 1e6:.2f} MB, written by {bag.library}"),
        ("recorded", f"{clock_time(bag.start_ns)}, {seconds:.1f} s"),
        ("messages", f"{bag.message_count} on {len(bag.topics)} topics"),
    ]
    known = dict(bag.metadata.get(PROVENANCE, {}))
    facts += [(name, known.pop(name)) for name in ("node", "host", "started") if name in known]
    if known:
        facts.append(("versions", ", ".join(f"{name} {value}" for name, value in known.items())))
    attached = [f"{name} ({len(data)} bytes)" for name, data in bag.attachments.items()]
    return [*facts, ("attached", ", ".join(attached) or "nothing")]
