"""Scenes of a bag's plans for their report: from the requests, or from topics as received."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from ff_planner_msgs.msg import PlanAnswer, PlanRequest

from ff_planner_ros.bag.reader import Bag, Message
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import BagError
from ff_planner_ros.messages.obstacles import bodies_of, scene_obstacles_of, spheres_of
from ff_planner_ros.planning.problem.problem import Obstacle, carried
from ff_planner_ros.ros.inputs.input_topics import (
    OBSTACLE_BODIES,
    OBSTACLES,
    TARGET_BODY,
    InputTopic,
)
from ff_planner_ros.runs.installed import PlanExchange
from ff_planner_ros.runs.recorded_inputs import Moment, heard, input_topic

SCENE_TOPICS = OBSTACLES, OBSTACLE_BODIES, TARGET_BODY


def heard_on(
    bag: Bag, found: Sequence[PlanExchange], drawn: Sequence[int], topic: InputTopic
) -> dict[int, Message]:
    """Return the messages that plans took from a topic, for want of that input in the request.

    Args:
        drawn: Indices in `found` of the exchanges to look at.

    Returns:
        By index in `found`; exchanges for which the bag has no message are missing.
    """
    scenes: dict[int, Message] = {}
    asked = {
        k: found[k]
        for k in drawn
        for request in (found[k].request,)
        if topic.is_used_by(PlanRequest() if request is None else request)
    }
    for namespace in dict.fromkeys(one.namespace for one in asked.values()):
        here = {k: one for k, one in asked.items() if one.namespace == namespace}
        try:
            topics = {topic.name: input_topic(bag, topic.name, namespace)}
        except BagError:
            continue  # the plan says that its obstacles are not known
        moments = [_moment(exchange, topic) for exchange in here.values()]
        for k, what in zip(here, heard(bag, topics, moments), strict=True):
            for message in what.get(topic.name, ()):
                scenes[k] = message
    return scenes


def _moment(exchange: PlanExchange, topic: InputTopic) -> Moment:
    stamp_ns = (
        nanoseconds(value_at(exchange.response.inputs, topic.stamp)) if exchange.response else 0
    )
    stamps_ns = {topic.name: stamp_ns} if stamp_ns else {}
    return Moment(exchange.logged_ns, stamps_ns, (topic.name,))


def obstacles_at_start(
    request: PlanRequest | None, answer: PlanAnswer, received: Mapping[str, Any]
) -> tuple[Obstacle, ...] | None:
    """Return the obstacles at a plan's start, without those of a target body; None: not known."""
    seen = since_stamp(answer.inputs.obstacles_stamp, answer)
    if request is not None and request.scene:
        return carried(scene_obstacles_of(request.scene[0], "scene"), seen)
    if OBSTACLES.name not in received:
        return None
    found: tuple[Obstacle, ...] = spheres_of(received[OBSTACLES.name], OBSTACLES.name)
    found = carried(found, seen)
    if OBSTACLE_BODIES.name in received:
        bodies = bodies_of(received[OBSTACLE_BODIES.name], OBSTACLE_BODIES.name)
        found += carried(bodies, since_stamp(answer.inputs.obstacle_bodies_stamp, answer))
    return found


def since_stamp(stamp: Time, answer: PlanAnswer) -> float:
    """Return the time from a stamp to the start of the plan in an answer [s]."""
    start_ns = nanoseconds(answer.plans[0].joint_trajectory.header.stamp)
    return (start_ns - nanoseconds(stamp)) / NANOSECONDS
