"""Input messages in a bag that the node had received by certain times."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import MappingProxyType
from typing import TypeAlias

from ff_planner_ros.bag.reader import Bag, Message
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.inputs.input_topics import (
    INPUT_TOPICS,
    OUTPUTS_OF_THESE_TYPES,
    header_stamp,
)
from ff_planner_ros.ros.messages.interfaces import type_name


@dataclass(frozen=True)
class Moment:
    """When the node read a request, and the inputs that the response depends on."""

    logged_ns: int  # time by the recorder's clock [ns]
    # Stamps of the messages that the response names, by input [ns]; of other inputs, all messages
    # that the node remembers are wanted
    stamps_ns: Mapping[str, int]
    inputs: Sequence[str]  # names of all inputs


# What the node had heard at a moment: messages by input, in the order of hearing.
Heard: TypeAlias = dict[str, list[Message]]


def input_topic(bag: Bag, name: str, namespace: str) -> str:
    """Return the topic of an input of a planner: by its name, or else the only one of its type.

    Args:
        name: Name of the input in `INPUT_TOPICS`.
        namespace: Namespace of the planner, without a trailing slash.

    Raises:
        BagError: No topic has the type, or several have it and none has the name.
    """
    wanted, kind = f"{namespace}/{name}", type_name(INPUT_TOPICS[name].message_type)
    topics = [
        topic.name
        for topic in bag.topics.values()
        if topic.type_name == kind and not topic.name.endswith(OUTPUTS_OF_THESE_TYPES)
    ]
    if wanted in topics:
        return wanted
    if len(topics) == 1:
        return topics[0]
    found = f"its topics of this type are {', '.join(topics)}" if topics else f"there is no {kind}"
    raise BagError(f"{wanted} is not in the bag: {found}")


def heard(
    bag: Bag,
    topics: Mapping[str, str],
    moments: Sequence[Moment],
    is_for_node: Mapping[str, Callable[[bytes], bool]] = MappingProxyType({}),
    names: Mapping[str, Callable[[bytes], Iterable[str]]] = MappingProxyType({}),
) -> list[Heard]:
    """Return the messages that the node had heard at each moment, as far as the bag has them.

    Args:
        bag: An open bag, which is read once.
        topics: Names of topics, by input.
        moments: In any order.
        is_for_node: By input, whether a message with these bytes is for the node, which takes the
            last other one as the reason for a refusal alone; without an entry: all are.
        names: By input, what of the node's interest other messages name, which heeds the last one
            on each; without an entry: nothing.

    Raises:
        BagError: The disk fails.
    """
    answers: list[Heard] = [{} for _ in moments]
    named = {topic: name for name, topic in topics.items()}
    first: dict[str, Message] = {}
    recent = {name: deque[Message](maxlen=INPUT_TOPICS[name].memory) for name in topics}
    other = {name: dict[tuple[str, ...], Message]() for name in topics}
    wanted = {item for moment in moments for item in moment.stamps_ns.items()}
    stamped: dict[tuple[str, int], list[Message]] = {}
    waiting = sorted(range(len(moments)), key=lambda i: moments[i].logged_ns, reverse=True)
    for message in bag.messages(*named) if named else ():
        while waiting and moments[waiting[-1]].logged_ns < message.log_time_ns:
            i = waiting.pop()
            _take_recent(answers[i], moments[i], recent, other)
        name = named[message.topic]
        if name in is_for_node and not is_for_node[name](message.cdr):
            about = tuple(names[name](message.cdr)) if name in names else ()
            other[name][about] = message
            continue
        first.setdefault(name, message)
        recent[name].append(message)
        key = (name, header_stamp(message.cdr))
        if key in wanted:
            stamped.setdefault(key, []).append(message)
    for i in waiting:
        _take_recent(answers[i], moments[i], recent, other)
    for moment, answer in zip(moments, answers, strict=True):
        _take_stamped(answer, moment, stamped)
        _take_first(answer, moment, first)
    return answers


def _take_recent(
    answer: Heard,
    moment: Moment,
    recent: Mapping[str, deque[Message]],
    other: Mapping[str, Mapping[tuple[str, ...], Message]],
) -> None:
    for name in moment.inputs:
        if name in recent and name not in moment.stamps_ns:
            beside = [one for about, one in other[name].items() if about or not recent[name]]
            answer[name] = sorted([*recent[name], *beside], key=attrgetter("log_time_ns"))


def _take_stamped(
    answer: Heard, moment: Moment, stamped: Mapping[tuple[str, int], list[Message]]
) -> None:
    """Take the messages that a response names; of equal stamps the last one before the moment."""
    for name, stamp_ns in moment.stamps_ns.items():
        same = stamped.get((name, stamp_ns), [])
        # A recorder may hear a message a little later than the node.
        before = [one for one in same if one.log_time_ns <= moment.logged_ns]
        if same:
            answer[name] = before[-1:] or same[:1]


def _take_first(answer: Heard, moment: Moment, first: Mapping[str, Message]) -> None:
    """Take the first message if none was recorded before: the recorder may hear it later.

    An optional input is not taken: the node may have had none.
    """
    for name in moment.inputs:
        is_open = name not in moment.stamps_ns and not answer.get(name)
        if name in first and is_open and not INPUT_TOPICS[name].optional:
            answer[name] = [first[name]]
