"""Message for `/diagnostics`, in words for an operator, from the node's state as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from ff_planner_ros.errors import Status
from ff_planner_ros.parameters.published_plans import TrackingParameters
from ff_planner_ros.ros.outputs.clock_health import ClockHealth, clock_part
from ff_planner_ros.ros.outputs.execution import ControllerHealth, controller_part
from ff_planner_ros.ros.outputs.prediction import Deviation, too_far
from ff_planner_ros.ros.recorder.recorder import RecorderHealth

# What has a higher age has no stamp, or zero: no clock of today is earlier than 2001 [s].
_NOT_STAMPED = 1e9
# Topics of the parts.
_STATES = "chaser_state", "odometry", "joint_states"
_SCENES, _TARGETS = ("obstacles",), ("target_body",)
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@dataclass(frozen=True)
class LastRequest:
    """The last request and its status."""

    plan_id: str
    status: Status
    message: str
    # Minimum clearances of the plan in words, by their labels; empty: there is no plan
    clearances: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class NodeHealth:
    """State of the node, from which its diagnostics are written."""

    # Age of the newest chaser state [s]; negative if stamped ahead; None without any
    state_age: float | None
    state_max_age: float  # beyond it none can be planned from [s]
    state_refusal: str  # why the newest one cannot be used; empty if it can
    obstacles: int | None  # spheres in the scene; None if none was received
    obstacles_age: float | None  # of the scene [s]; None: it is not stamped
    obstacles_refusal: str  # why the scene cannot be used; empty if it can
    target_age: float | None  # of the newest target body [s]; None without any
    target_max_age: float  # beyond it none can be captured [s]
    target_refusal: str  # why the newest one cannot be used; empty if it can
    last: LastRequest | None  # None before the first request
    solve_times: Sequence[float]  # of the last answers [s]
    solver_is_warm: bool  # whether a plan can begin at once
    namesakes: Sequence[str]  # nodes that answer requests under the same name
    recorder: RecorderHealth
    tracking: Sequence[Deviation]  # of the measured system; empty while no plan runs
    allowed: TrackingParameters  # more is a warning
    # Stamp of the last message minus its time of arrival [s]; None: not known
    state_clock_offset: float | None = None
    target_clock_offset: float | None = None
    # A phrase for each publisher that the node cannot hear, by topic
    unheard: Mapping[str, Sequence[str]] = field(default_factory=dict)
    obstacle_bodies: int = 0  # in the scene, beside the spheres
    obstacles_source: str = ""  # of the scene, as its message says
    # Whether a publisher of the obstacles exists
    obstacles_are_published: bool = True
    controller: ControllerHealth = field(default_factory=ControllerHealth)
    clock: ClockHealth = field(default_factory=ClockHealth)
    # Since when no chaser state was received, as the end of a sentence
    state_since: str = "yet"


def diagnostics(health: NodeHealth, node: str, stamp: Time) -> DiagnosticArray:
    """Return one status for each part of the node, always the same parts in the same order."""
    parts = {
        "chaser state": _with_unheard(_state(health), health, _STATES),
        "obstacles": _with_unheard(_obstacles(health), health, _SCENES),
        "target body": _with_unheard(_target_body(health), health, _TARGETS),
        "last request": _last(health),
        "solver": _solver(health),
        "solve time": _solve_time(health),
        "other planners": _other_planners(health),
        "recorder": _recorder(health),
        "tracking": _tracking(health),
        "controller": controller_part(health.controller),
        "clock": clock_part(health.clock),
    }
    return DiagnosticArray(
        header=Header(stamp=stamp),
        status=[
            DiagnosticStatus(
                level=level,
                name=f"{node}: {part}",
                message=message,
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
            for part, (level, message, values) in parts.items()
        ],
    )


# Level, sentence, and the figures in it for machines.
_Part = tuple[bytes, str, Mapping[str, str]]


def _with_unheard(part: _Part, health: NodeHealth, topics: Sequence[str]) -> _Part:
    """Return a part, with the publishers that the node cannot hear added to its message."""
    level, message, values = part
    words = [f"{name}: {one}" for name in topics for one in health.unheard.get(name, ())]
    if not words:
        return part
    return max(level, WARN), f"{message}; not heard: {'; '.join(words)}", values


def _state(health: NodeHealth) -> _Part:
    age, limit = health.state_age, health.state_max_age
    if age is None:
        return ERROR, f"no chaser state received {health.state_since}: is it published?", {}
    refusal = health.state_refusal and f"cannot be planned from: {health.state_refusal}"
    return _of_age(age, limit, 3, refusal, ERROR, health.state_clock_offset)


def _obstacles(health: NodeHealth) -> _Part:
    if health.obstacles is None:
        message = "none received yet: publish them, or an empty scene if nothing is in the way"
        return ERROR, message, {}
    values, age = {"spheres": str(health.obstacles)}, "not stamped"
    if health.obstacles_age is not None:
        values["age [s]"] = f"{health.obstacles_age:.1f}"
        age = f"{health.obstacles_age:.1f} s old"
    if health.obstacles_source:
        values["source"] = health.obstacles_source
    if health.obstacles_refusal:
        return ERROR, f"cannot be planned around: {health.obstacles_refusal}", values
    told = f"{health.obstacles} sphere{'' if health.obstacles == 1 else 's'}"
    if health.obstacle_bodies:
        values["bodies"] = str(health.obstacle_bodies)
        told += f" and {health.obstacle_bodies} bod{'y' if health.obstacle_bodies == 1 else 'ies'}"
    message = f"{told}, {age}"
    if not health.obstacles_are_published:
        return WARN, f"{message}: their publisher is gone, and nobody tells of changes", values
    return OK, message, values


def _target_body(health: NodeHealth) -> _Part:
    age, limit = health.target_age, health.target_max_age
    if age is None:
        return OK, "none received: only a request that brings one can capture it", {}
    refusal = health.target_refusal and f"cannot be captured: {health.target_refusal}"
    return _of_age(age, limit, 1, refusal, WARN, health.target_clock_offset)


def _of_age(
    age: float, limit: float, digits: int, refusal: str, level: bytes, offset: float | None
) -> _Part:
    """Return the part of an input, from the age of its newest message and the age allowed [s].

    Args:
        digits: Decimals of the age.
        refusal: Why the newest message cannot be used; empty: it can.
        level: Level if the newest message cannot be used or is too old.
        offset: Stamp of the newest message minus its time of arrival [s]; None: not known.
    """
    values = {"age [s]": f"{age:.{digits}f}", "allowed age [s]": f"{limit:g}"}
    if offset is not None:
        values["clock offset [s]"] = f"{offset:.3f}"
    if refusal:
        return level, refusal, values
    if age > max(limit, _NOT_STAMPED):
        return level, f"the newest is not stamped, and may be {limit:g} s old at most", values
    if age > limit:
        why = "has its publisher died?"
        if offset is not None and -offset > limit:
            why = (
                f"messages come with stamps {-offset:.3f} s behind, so its publisher's clock is so "
                "much behind this node's, or they are so long on their way"
            )
        return level, f"the newest is {age:.1f} s old, allowed are {limit:g} s: {why}", values
    return OK, f"the newest is {age:.{digits}f} s old", values


def _last(health: NodeHealth) -> _Part:
    last = health.last
    if last is None:
        return OK, "no request yet", {}
    values = {"plan id": last.plan_id, "code": str(int(last.status)), "status": last.status.name}
    values |= last.clearances
    if last.status is Status.SOLVED:
        return OK, f"{last.plan_id} solved", values
    level = ERROR if last.status >= Status.INTERNAL_ERROR else WARN
    return level, f"{last.plan_id} got no plan, {last.status.name}: {last.message}", values


def _solve_time(health: NodeHealth) -> _Part:
    answers = len(health.solve_times)
    if answers == 0:
        return OK, "no answer yet", {}
    median, most, worst = np.percentile(health.solve_times, (50, 95, 100))
    values = {
        "median [s]": f"{median:.3f}",
        "95 % [s]": f"{most:.3f}",
        "worst [s]": f"{worst:.3f}",
        "answers": str(answers),
    }
    of = f"the last {answers} answers" if answers > 1 else "the only answer"
    return OK, f"median {median:.2f} s, 95 % within {most:.2f} s, of {of}", values


def _solver(health: NodeHealth) -> _Part:
    values = {"warm": str(health.solver_is_warm).lower()}
    if health.solver_is_warm:
        return OK, "ready", values
    return WARN, "loads its libraries: a request waits for it", values


def _other_planners(health: NodeHealth) -> _Part:
    others = health.namesakes
    if not others:
        return OK, "none in this namespace", {"others": "0"}
    message = (
        f"the same requests are answered by {', '.join(others)}, too: an answer may come from any, "
        "and all publish plans; stop all but one, or move them to other namespaces. A node that "
        "has just died counts until the middleware has noticed that"
    )
    return ERROR, message, {"others": str(len(others))}


def _recorder(health: NodeHealth) -> _Part:
    recorder = health.recorder
    dropped = sum(recorder.dropped.values())
    values = {
        "bag": recorder.bag,
        "messages": str(recorder.messages),
        "dropped": str(dropped),
        **{f"dropped {topic}": str(n) for topic, n in sorted(recorder.dropped.items())},
    }
    if recorder.failure:
        message = f"recording has stopped, planning goes on: {recorder.failure}"
        return ERROR, message, values | {"failure": recorder.failure}
    if dropped:
        topic, most = max(recorder.dropped.items(), key=itemgetter(1))
        message = (
            f"recording to {recorder.bag}, but was too slow for {dropped} messages, {most} of them "
            f"of {topic}"
        )
        return WARN, message, values
    return OK, f"recording to {recorder.bag}", values


def _tracking(health: NodeHealth) -> _Part:
    if not health.tracking:
        return OK, "no plan runs", {}
    position, angle = (one.amount for one in health.tracking[:2])
    values = {
        "position [m]": f"{position:.6f}",
        "allowed position [m]": f"{health.allowed.max_position:g}",
        "angle [rad]": f"{angle:.6f}",
        "allowed angle [rad]": f"{health.allowed.max_angle:g}",
    }
    if off := too_far(health.tracking, health.allowed):
        return WARN, f"the system leaves the plan: {off}", values
    found = f"{position * 1e3:.1f} mm and {math.degrees(angle):.2f} deg"
    return OK, f"the chaser is {found} from where the plan predicts it", values
