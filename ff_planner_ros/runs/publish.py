"""Play a bag into ROS: the recorded bytes, at their times, with their quality of service."""

from __future__ import annotations

import contextlib
import heapq
import signal
import sys
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from ff_planner_ros.bag.mcap.definition import message_definition
from ff_planner_ros.bag.reader import Bag, Topic, open_bag
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import BagError, InvalidInput
from ff_planner_ros.ros.inputs.input_topics import INPUT_TOPICS, OUTPUTS_OF_THESE_TYPES
from ff_planner_ros.ros.joining import joining_ros
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import time_message

ALL = "all"

_CLOCK = "/clock"
# Of the recorder's time: finer than any planner's allowance is counted in [ns].
_CLOCK_STEP_NS = 10_000_000
# Longest wait until present subscribers are found [s].
_DISCOVERY, _DISCOVERY_POLL = 3.0, 0.02
# Least time that these are given to find the publishers, too, which nothing tells [s].
_FOUND_IN_TURN = 0.2
# Longest wait until reliable messages have arrived.
_LAST_ACKS = Duration(seconds=1)
# For bags of other tools that hold no profile, or an unknown one.
_DEFAULT_QOS = QoSProfile(depth=10)
_RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "1": ReliabilityPolicy.RELIABLE,
    "2": ReliabilityPolicy.BEST_EFFORT,
}
_DURABILITY = {
    "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
    "volatile": DurabilityPolicy.VOLATILE,
    "1": DurabilityPolicy.TRANSIENT_LOCAL,
    "2": DurabilityPolicy.VOLATILE,
}


# As rclpy calls what a type's name has of an action.
_ACTION_PARTS = {"SendGoal": "SendGoalService", "GetResult": "GetResultService"}


@dataclass(order=True, frozen=True)
class _Due:
    """A message and when it goes out."""

    at_ns: int
    number: int
    topic: str = field(compare=False)
    message: Any = field(compare=False)  # bytes as recorded, or a Clock


def publish_bag(path: Path, rate: float, topics: Collection[str], clock: bool) -> int:
    """Play a bag until its end or until SIGINT or SIGTERM.

    The first message of every latched topic is sent at once, so that robot and obstacles are
    known when the first state comes. All others keep their distances in time.

    Args:
        rate: Factor on the recorded speed.
        topics: Names of topics, or `ALL`; none: the planner's inputs.
        clock: Whether to publish /clock: the stamps in the messages are those of then, and only
            a node with use_sim_time takes them for current.

    Returns:
        Exit code, 0.

    Raises:
        BagError: The bag cannot be read, or has no such topic, or none of a type that is
            installed.
    """
    stop = threading.Event()
    with open_bag(path) as bag, _signals(stop), _node() as node:
        chosen = _chosen(bag, topics)
        publishers = _publishers(node, chosen)
        if not publishers:
            raise BagError(f"bag {path}: no topic of it has a type that is installed")
        topics_played = len(publishers.keys() - ({_CLOCK} if clock else set()))
        if clock:
            publishers[_CLOCK] = node.create_publisher(Clock, _CLOCK, _DEFAULT_QOS)
        _wait_for_subscribers(publishers, stop)
        latched = {topic.name for topic in chosen if _is_latched(_qos(topic))}
        count = _play(bag, publishers, latched & publishers.keys(), rate, clock, stop)
        for publisher in publishers.values():
            publisher.wait_for_all_acked(_LAST_ACKS)
        for note in bag.notes:
            print(f"ff-planner: note: {note}", file=sys.stderr)
        print(f"published {count} messages of {topics_played} topics")
    return 0


def _play(
    bag: Bag,
    publishers: dict[str, Publisher],
    latched: Collection[str],
    rate: float,
    clock: bool,
    stop: threading.Event,
) -> int:
    """Publish every message when it is due; how many went out."""
    names = [name for name in publishers if name != _CLOCK or not clock]
    first = {name: next(bag.messages(name), None) for name in latched}
    begun, count = time.monotonic(), 0
    for message in first.values():
        if message is not None:
            publishers[message.topic].publish(message.cdr)
            count += 1
    recorded = (
        _Due(message.log_time_ns, number, message.topic, message.cdr)
        for number, message in enumerate(bag.messages(*names))
        if first.get(message.topic) != message
    )
    ticks = _ticks(bag) if clock else iter(())
    for due in heapq.merge(ticks, recorded):
        wait = begun + (due.at_ns - bag.start_ns) / 1e9 / rate - time.monotonic()
        if stop.wait(max(wait, 0.0)):
            break
        publishers[due.topic].publish(due.message)
        count += due.topic != _CLOCK or not clock
    return count


def _ticks(bag: Bag) -> Iterator[_Due]:
    """Yield the time of recording, from begin to end; before the messages of the same time."""
    for at_ns in range(bag.start_ns, bag.end_ns + _CLOCK_STEP_NS, _CLOCK_STEP_NS):
        yield _Due(at_ns, -1, _CLOCK, Clock(clock=time_message(at_ns)))


def _chosen(bag: Bag, names: Collection[str]) -> list[Topic]:
    if ALL in names:
        return list(bag.topics.values())
    if names:
        wanted = [name if name.startswith("/") else f"/{name}" for name in names]
        for name in wanted:
            if name not in bag.topics:
                found = ", ".join(bag.topics) or "none"
                raise BagError(f"bag {bag.path} has no topic {name}; it has {found}")
        return [bag.topics[name] for name in wanted]
    types = {type_name(topic.message_type) for topic in INPUT_TOPICS.values()}
    inputs = [
        topic
        for topic in bag.topics.values()
        if topic.type_name in types and not topic.name.endswith(OUTPUTS_OF_THESE_TYPES)
    ]
    if not inputs:
        raise BagError(
            f"bag {bag.path} holds none of the planner's inputs ({', '.join(sorted(types))}); "
            f"choose from its topics with --topics: {', '.join(bag.topics) or 'none'}"
        )
    return inputs


def _publishers(node: Node, topics: Collection[Topic]) -> dict[str, Publisher]:
    """Return a publisher for each topic; those of types that are not installed are named."""
    publishers = {}
    for topic in topics:
        message_type = _message_type(topic.type_name)
        if message_type is None:
            words = f"{topic.name} is left out: its type {topic.type_name} is not installed here"
            print(f"ff-planner: note: {words}", file=sys.stderr)
        else:
            publishers[topic.name] = node.create_publisher(message_type, topic.name, _qos(topic))
    return publishers


def _message_type(name: str) -> Any:
    """Return an installed message class, a part of a service or an action included; or None."""
    try:
        message_definition(name)  # a bag must not cause imports of other modules
        package, kind, stem = name.split("/")
        owner, *parts = stem.split("_")  # a message's own name has no underscore
        found: Any = getattr(import_module(f"{package}.{kind}"), owner)
        if kind == "action":
            parts = ["Impl", *(_ACTION_PARTS.get(part, part) for part in parts)]
        for part in parts:
            found = getattr(found, part)
    except (BagError, ImportError, AttributeError):
        return None
    return found


def _qos(topic: Topic) -> QoSProfile:
    """Return the quality of service that the first publisher of a recorded topic offered."""
    with contextlib.suppress(InvalidInput, LookupError, TypeError, ValueError):
        offered = yaml_document(topic.offered_qos_profiles, "offered_qos_profiles", "damaged")[0]
        return QoSProfile(
            depth=max(int(offered["depth"]), 1),
            reliability=_RELIABILITY[str(offered["reliability"])],
            durability=_DURABILITY[str(offered["durability"])],
        )
    return _DEFAULT_QOS


def _is_latched(qos: QoSProfile) -> bool:
    return bool(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def _wait_for_subscribers(publishers: dict[str, Publisher], stop: threading.Event) -> None:
    """Wait until present subscribers are found: volatile messages would be lost before."""
    begun = time.monotonic()
    while (took := time.monotonic() - begun) < _DISCOVERY and not stop.wait(_DISCOVERY_POLL):
        if all(publisher.get_subscription_count() for publisher in publishers.values()):
            stop.wait(max(took, _FOUND_IN_TURN))  # a busy machine takes as long both ways
            return


@contextmanager
def _node() -> Iterator[Node]:
    with joining_ros():
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with joining_ros():
            node = rclpy.create_node(
                "ff_planner_player", enable_rosout=False, start_parameter_services=False
            )
        yield node
    finally:
        rclpy.try_shutdown()


@contextmanager
def _signals(stop: threading.Event) -> Iterator[None]:
    """End cleanly on SIGINT and SIGTERM."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: stop.set()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
