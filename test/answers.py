"""Answers of the planner, the exchanges that tell of them, and bags of these."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ff_planner_msgs.msg import Exchange, PlanAnswer, PlanRequest
from std_msgs.msg import Header

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import plan_message, time_message

FRAME = "inertial"
EXCHANGES = "/exchanges"  # topic of the planner that is asked, where a test names no other


def answer_with(
    plan: Plan,
    plan_id: str = "run.1",
    start_ns: int = 10**18,
    solve_time: float = 0.1,
    body: TargetBody | None = None,
) -> PlanAnswer:
    """Answer with a plan, as the node does."""
    answer = answer_of(plan, plan_id, solve_time, None, start_ns, FRAME)
    if body is not None:
        answer.plans = [plan_message(plan, start_ns, FRAME, CapturedBody(body))]
    return answer


def exchange(
    answer: PlanAnswer | None = None, request: PlanRequest | None = None, ns: int = 0, **told: Any
) -> Exchange:
    """Tell of an answer, or else of the request, at a time of the node's clock [ns]."""
    return Exchange(
        **{
            "plan_id": "run.1" if answer is None else answer.plan_id,
            "interface": "service",
            "event": "received" if answer is None else "answered",
            "header": Header(stamp=time_message(ns), frame_id=FRAME),
            "request": [] if request is None else [request],
            "answer": [] if answer is None else [answer],
            **told,
        }
    )


def write_bag(
    directory: Path,
    *messages: Any,
    start_ns: int = 0,
    step_ns: int = 1,
    attached: Mapping[str, bytes] = MappingProxyType({}),
) -> Path:
    """Write messages to a bag, evenly in time: exchanges, or pairs of topic and message."""
    with BagWriter(directory, flush_interval=0.0) as bag:
        for name, data in attached.items():
            bag.attach(name, "text/plain", data)
        known = set[str]()
        for now, one in zip(itertools.count(start_ns, step_ns), messages, strict=False):
            topic, message = one if isinstance(one, tuple) else (EXCHANGES, one)
            if topic not in known:
                bag.add_topic(topic, type_name(type(message)), [])
                known.add(topic)
            bag.write(topic, encode(message), now, now)
    return directory
