"""The report of a bag: its requests, and its plans beside what was measured while they ran."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PlanAnswer, PlanRequest

from ff_planner_ros.analysis.drawing.tracking import deviations, measured_motion
from ff_planner_ros.bag.provenance import PROVENANCE
from ff_planner_ros.bag.publications import publications
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.bag.robot_plans import asked_phases, attached_robot, phases_of
from ff_planner_ros.bag.scenes import asked_scene
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import BagError, FfPlannerError, InvalidInput, Status
from ff_planner_ros.messages.payloads import robot_holding
from ff_planner_ros.messages.plans import (
    metrics_from_message,
    plan_from_answer,
    solver_report_from_message,
)
from ff_planner_ros.messages.target_bodies import captures
from ff_planner_ros.messages.trajectories import trajectory_in
from ff_planner_ros.messages.wheels import wheels_in
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.problem import (
    Objective,
    TargetBody,
    with_attached,
)
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.report.received_scenes import (
    SCENE_TOPICS,
    heard_on,
    obstacles_at_start,
    since_stamp,
)
from ff_planner_ros.report.run_report import (
    Report,
    ReportedPlan,
    ReportedRequest,
    clock_time,
    reported_plan,
    robot_facts,
)
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.input_topics import TARGET_BODY
from ff_planner_ros.ros.messages.from_messages import target_body_from_message
from ff_planner_ros.runs.installed import (
    PlanExchange,
    as_installed,
    brief_exchanges,
    never_published,
    with_motion,
)
from ff_planner_ros.runs.measured import Window, fill_windows
from ff_planner_ros.runs.recorded_parameters import RecordedParameters

_UNPUBLISHED = "It was asked for with plan_only, and never published: nobody executed it."


def report_of_bag(path: Path, most_plans: int) -> Report:
    """Return the report of a run, the last `most_plans` of its plans drawn.

    Raises:
        BagError: The bag cannot be read at all.
    """
    with open_bag(path) as bag:
        return _report_of_bag(bag, most_plans)


def _report_of_bag(bag: Bag, most_plans: int) -> Report:
    notes: list[str] = []
    parameters = _parameters(bag, notes)
    robot = None
    try:
        robot = attached_robot(bag.path, bag.attachments)
    except FfPlannerError as error:
        notes.append(f"no plan is drawn: {error}")
    found = brief_exchanges(bag)
    requests = [_request(exchange) for exchange in found]
    solved = [k for k, request in enumerate(requests) if request.code == Status.SOLVED]
    drawn = solved[max(len(solved) - most_plans, 0) :] if robot is not None else []
    if robot is not None and len(drawn) < len(solved):
        notes.append(
            f"of {len(solved)} plans the last {len(drawn)} are drawn; --plans N draws more"
        )
    if robot is not None and drawn:
        found = [with_motion(bag, one) if k in drawn else one for k, one in enumerate(found)]
        plans = _plans(bag, robot, parameters, found, drawn, notes)
        requests = [_with_plans(one, plans.get(k, [])) for k, one in enumerate(requests)]
    facts = (*_bag_facts(bag), *(robot_facts(robot) if robot else ()))
    published = tuple(publications(bag))
    return Report(bag.path.name, facts, (*bag.notes, *notes), tuple(requests), published)


def _with_plans(request: ReportedRequest, plans: Sequence[ReportedPlan]) -> ReportedRequest:
    return replace(request, plan=plans[0], then=tuple(plans[1:])) if plans else request


def _plans(
    bag: Bag,
    robot: Robot,
    parameters: NodeParameters | None,
    found: Sequence[PlanExchange],
    drawn: Sequence[int],
    notes: list[str],
) -> dict[int, list[ReportedPlan]]:
    """Return the plans to draw, one a phase, by the number of their request.

    What cannot be drawn makes a note.
    """
    plans: dict[int, list[ReportedPlan]] = {}
    windows: dict[int, list[Window]] = {}
    heard_of = {topic: heard_on(bag, found, drawn, topic) for topic in SCENE_TOPICS}
    unpublished = never_published(bag, found)
    executed = [one for one in found if one.response and one.response.plan_id not in unpublished]
    for k in drawn:
        try:
            received = {
                topic.name: as_installed(bag.decode(messages[k]), topic.message_type)
                for topic, messages in heard_of.items()
                if k in messages
            }
            phases = _phases(found[k], robot_holding(robot, found[k].request), received)
            if found[k] in executed:
                windows[k] = _windows(executed, executed.index(found[k]))
            else:
                phases = [replace(one, remarks=(*one.remarks, _UNPUBLISHED)) for one in phases]
            plans[k] = phases
        except (BagError, InvalidInput, LookupError, ValueError) as error:
            notes.append(
                f"{value_at(found[k].response, 'plan_id', 'an answer')} is not drawn: {error}"
            )
    if parameters is not None:
        fill_windows(bag, robot, parameters, [one for of_one in windows.values() for one in of_one])
    for k, of_one in windows.items():
        pairs = zip(plans[k], of_one, strict=True)
        plans[k] = [_with_measured(plan, window, parameters) for plan, window in pairs]
    return plans


def _parameters(bag: Bag, notes: list[str]) -> NodeParameters | None:
    """Return the node's parameters; None: they are not in the bag, which makes a note."""
    try:
        node = bag.metadata.get(PROVENANCE, {}).get("node", "")
        recorded = RecordedParameters(bag, node)
    except BagError as error:
        notes.append(str(error))
        return None
    notes += recorded.notes
    return recorded.at(bag.end_ns)


def _request(exchange: PlanExchange) -> ReportedRequest:
    """Return the row of a table."""
    return replace(
        reported_request(exchange.door, exchange.request, exchange.response),
        asked_ns=exchange.received_ns or None,
        answered_ns=exchange.answered_ns or None,
    )


def reported_request(
    door: str, request: PlanRequest | None, answer: PlanAnswer | None
) -> ReportedRequest:
    """Return the row of a request and its answer, without the plans to draw.

    Args:
        door: Interface that the request came in by.
    """
    found = ReportedRequest(plan_id="", door=door, message="no answer is in the bag")
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
        plan_id=answer.plan_id,
        received_ns=nanoseconds(answer.inputs.received_stamp) or None,
        code=answer.status.code,
        message=answer.status.message,
        solve_time=answer.solver.solve_time or None,
        guessed=len(answer.inputs.first_guess) > 0,
    )
    if answer.metrics:
        metrics = metrics_from_message(answer.metrics[0])
        solver = solver_report_from_message(answer.solver)
        found = replace(found, metrics=metrics, solver=solver)
    if _is_plan(answer):
        start_ns, _ = _span(answer.plans[0])
        points = len(answer.plans[0].joint_trajectory.points)
        found = replace(found, start_ns=start_ns, points=points)
    return found


def _phases(
    exchange: PlanExchange, robot: Robot, received: Mapping[str, Any]
) -> list[ReportedPlan]:
    """Return the plan of each phase with its scene; `received` has messages by topic name."""
    answer = exchange.response
    if answer is None or not answer.plans:
        raise BagError("the bag holds no plan of it")
    plan = plan_from_answer(answer)
    motions = [trajectory_in(one) for one in answer.plans]
    if plan.joint_names != robot.joint_names:
        names, wanted = ", ".join(plan.joint_names), ", ".join(robot.joint_names)
        allowed = f"the robot of the bag has {wanted}"
        raise InvalidInput(Status.UNKNOWN_JOINT, "joint_trajectory.joint_names", names, allowed)
    for motion in motions:
        require_sound_samples(robot, motion)
    request, told = exchange.request, Scene()
    body: TargetBody | None = None
    if request is not None:
        body_message = received.get(TARGET_BODY.name)
        body_message = request.target_body[0] if request.target_body else body_message
        told = asked_scene(request).scene
        told = replace(told, capture_time=answer.plans[0].duration)
        if captures(request) and body_message is not None:
            body = target_body_from_message(body_message, body_message.header.frame_id)
            body = body.after(since_stamp(answer.inputs.target_body_stamp, answer))
            told = replace(told, target_body=body)
    obstacles = obstacles_at_start(request, answer, received)
    if obstacles is not None and body is not None:
        obstacles = with_attached(obstacles, body)
    around, drawn = replace(told, obstacles=obstacles or ()), list[ReportedPlan]()
    of_phases = phases_of(motions, robot, around, asked_phases(request), plan.duration)
    for message, (motion, holding, scene) in zip(answer.plans, of_phases, strict=True):
        known = None if obstacles is None else tuple(scene.obstacles)
        wheels = wheels_in(message)
        drawn.append(reported_plan(holding, motion, known, scene, wheels))
    return drawn


def _windows(found: Sequence[PlanExchange], k: int) -> list[Window]:
    """Return the time window of each phase of a plan, cut where the next plan starts."""
    namespace = found[k].namespace
    mine, *later = (
        [_span(plan) for plan in exchange.response.plans]
        for exchange in found[k:]
        if exchange.namespace == namespace
        and exchange.response is not None
        and _is_plan(exchange.response)
    )
    frame = value_at(found[k].response, "plans[0].chaser_path.header.frame_id")
    taken_ns = [start_ns for (start_ns, _), *_ in later]
    return [Window(namespace, frame, start, min([end, *taken_ns])) for start, end in mine]


def _is_plan(answer: PlanAnswer) -> bool:
    return answer.status.code == Status.SOLVED and bool(
        value_at(answer, "plans[0].joint_trajectory.points", ())
    )


def _span(plan: PlanMessage) -> tuple[int, int]:
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
    tolerance = parameters.following_tolerance if parameters is not None else np.inf
    if worst > tolerance:
        remarks.append(
            f"A joint was {worst:.3g} rad off the plan, more than following_tolerance, "
            f"{tolerance:g} rad: the plan was not executed, or not to its end."
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
