"""The measured states of a bag while plans ran."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from ff_planner_ros.bag.reader import Bag, Message
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import BagError, InvalidInput
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.from_messages import state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    chaser_from_odometry,
    is_pair,
    joints_from_joint_state,
    merged,
)
from ff_planner_ros.ros.messages.interfaces import header_stamp, type_name
from ff_planner_ros.ros.messages.joint_names import joints_named
from ff_planner_ros.ros.topics import (
    CHASER_STATE,
    JOINT_STATES,
    ODOMETRY,
    PLANNED_JOINT_STATES,
    Endpoint,
)

# Per plan, evenly in time: each takes a tenth of a millisecond, and a curve shows 400 of them.
MOST_STATES = 5_000
# Errors that a message decoded by another definition than ours may raise
_UNREADABLE = (InvalidInput, BagError, AttributeError, TypeError, ValueError)

Stamped: TypeAlias = tuple[int, Message]  # with the time of its measurement [ns]


@dataclass(eq=False)
class Window:
    """A time span during which states are wanted, and the states found."""

    namespace: str  # of the node whose plan runs, without a trailing slash
    frame: str  # the inertial frame of the plan
    start_ns: int  # first time that is wanted [ns]
    end_ns: int  # last time that is wanted [ns]
    # By the time of their measurement [ns]
    states: dict[int, SystemState] = field(default_factory=dict)
    # Reasons why messages could not be read as a state of the robot
    unusable: list[str] = field(default_factory=list)
    left_out: int = 0  # number of messages not read, because there are more than MOST_STATES


def fill_windows(
    bag: Bag, robot: Robot, parameters: NodeParameters, windows: Sequence[Window]
) -> None:
    """Fill windows with the measured states in a bag, read from the topics of `state_source`.

    Raises:
        BagError: The disk fails.
    """
    if parameters.state_source == "odometry":
        _measure_apart(bag, robot, parameters, windows)
        return
    for window, kept in zip(windows, _kept(bag, CHASER_STATE, windows), strict=True):
        for stamp_ns, message in kept:
            try:
                state = bag.decode(message)
                found = state_from_message(state, CHASER_STATE.name, robot, window.frame)
            except _UNREADABLE as error:
                window.unusable.append(str(error))
            else:
                window.states[stamp_ns] = found


def _measure_apart(
    bag: Bag, robot: Robot, parameters: NodeParameters, windows: Sequence[Window]
) -> None:
    """Fill windows with states from odometry and the joint states nearest to it in time."""
    kept, sensor = _kept(bag, ODOMETRY, windows), parameters.odometry
    nearest = _nearest(bag, robot, windows, kept)
    for window, chasers, arms in zip(windows, kept, nearest, strict=True):
        for (stamp_ns, odometry), near in zip(chasers, arms, strict=True):
            try:
                chaser = chaser_from_odometry(bag.decode(odometry), window.frame, sensor)
                parts = [
                    joints_from_joint_state(bag.decode(joint_states), robot)
                    for apart_ns, joint_states in near
                    if is_pair(apart_ns / NANOSECONDS, parameters.state_synchronization)
                ]
                if not parts or np.isnan(arm := merged(parts)).any():
                    raise BagError("no joint_states are near enough to pair with odometry")
            except _UNREADABLE as error:
                window.unusable.append(str(error))
            else:
                window.states[stamp_ns] = SystemState(*chaser, *arm)


def _kept(bag: Bag, topic: Endpoint, windows: Sequence[Window]) -> list[list[Stamped]]:
    """Return the messages of each window by stamp, at most one per `MOST_STATES`-th of its span.

    Of messages with the same stamp the last counts.
    """
    kept: dict[int, dict[int, Stamped]] = defaultdict(dict)
    for number, stamp_ns, message in _stamped(bag, topic, windows):
        window = windows[number]
        span_ns = max(window.end_ns - window.start_ns, MOST_STATES)
        time = (stamp_ns - window.start_ns) * MOST_STATES // (span_ns + 1)
        before = kept[number].get(time)
        if before is None or before[0] == stamp_ns:
            kept[number][time] = stamp_ns, message
        else:
            window.left_out += 1
    return [[kept[n][time] for time in sorted(kept[n])] for n in range(len(windows))]


def _nearest(
    bag: Bag, robot: Robot, windows: Sequence[Window], kept: Sequence[Sequence[Stamped]]
) -> list[list[list[tuple[int, Message]]]]:
    """Return the joint states nearest to each message kept, and how far they are apart [ns].

    Nearest first, one of each set of joints that messages tell of. Of joint states equally near,
    the last heard is taken.
    """
    stamps = [[stamp_ns for stamp_ns, _ in messages] for messages in kept]
    # Between two messages kept, only the first and the last joint states can be the nearest.
    ends = defaultdict[tuple[int, frozenset[str]], tuple[dict[int, Stamped], dict[int, Stamped]]](
        lambda: ({}, {})
    )
    joints_in = joints_named(robot.joint_names)
    for number, stamp_ns, message in _stamped(bag, JOINT_STATES, windows):
        names = frozenset(joints_in(message.cdr))
        if not names:
            continue
        first, last = ends[number, names]
        gap = bisect_left(stamps[number], stamp_ns)
        if gap not in first or stamp_ns <= first[gap][0]:
            first[gap] = stamp_ns, message
        if gap not in last or stamp_ns >= last[gap][0]:
            last[gap] = stamp_ns, message
    near: list[list[list[tuple[int, Message]]]] = [[[] for _ in one] for one in stamps]
    for (number, _), (first, last) in ends.items():
        found = _nearest_of(stamps[number], first, last)
        for one, nearest in zip(near[number], found, strict=True):
            one.append(nearest)
            one.sort(key=itemgetter(0))
    return near


def _nearest_of(
    stamps: Sequence[int], first: Mapping[int, Stamped], last: Mapping[int, Stamped]
) -> list[tuple[int, Message]]:
    """Return the nearest joint states to each stamp, from the first and last in each gap."""
    before, after = list[Stamped | None](), list[Stamped | None]()
    for k in range(len(stamps)):
        before.append(last.get(k, before[-1] if before else None))
    for k in range(len(stamps), 0, -1):
        after.append(first.get(k, after[-1] if after else None))
    found: list[tuple[int, Message]] = []
    for stamp_ns, *both in zip(stamps, before, reversed(after), strict=True):
        near = [(abs(at_ns - stamp_ns), one) for at_ns, one in filter(None, both)]
        found.append(min(near, key=lambda pair: (pair[0], -pair[1].log_time_ns)))
    return found


def _stamped(
    bag: Bag, topic: Endpoint, windows: Sequence[Window]
) -> Iterator[tuple[int, int, Message]]:
    """Yield each message with its stamp [ns], and with the number of each window it is in."""
    heard: dict[str, list[int]] = defaultdict(list)
    for number, window in enumerate(windows):
        try:
            heard[input_topic(bag, topic, window.namespace)].append(number)
        except BagError as error:
            window.unusable.append(str(error))
    # Most of a long run is between the plans.
    for message in bag.messages(*heard, only=_stamped_in(windows)) if heard else ():
        stamp_ns = header_stamp(message.cdr)
        for number in heard[message.topic]:
            if windows[number].start_ns <= stamp_ns <= windows[number].end_ns:
                yield number, stamp_ns, message


def input_topic(bag: Bag, topic: Endpoint, namespace: str) -> str:
    """Return the topic of an input of a planner: by its name, or else the only one of its type.

    Args:
        namespace: Namespace of the planner, without a trailing slash.

    Raises:
        BagError: No topic has the type, or several have it and none has the name.
    """
    wanted, kind = f"{namespace}/{topic.name}", type_name(topic.message_type)
    topics = [
        one.name
        for one in bag.topics.values()
        if one.type_name == kind and not one.name.endswith(PLANNED_JOINT_STATES.name)
    ]
    if wanted in topics:
        return wanted
    if len(topics) == 1:
        return topics[0]
    found = f"its topics of this type are {', '.join(topics)}" if topics else f"there is no {kind}"
    raise BagError(f"{wanted} is not in the bag: {found}")


def _stamped_in(windows: Sequence[Window]) -> Callable[[bytes], bool]:
    """Return a function that decides from a message's bytes if its stamp is in any window."""
    starts: list[int] = []
    ends: list[int] = []
    for start, end in sorted((window.start_ns, window.end_ns) for window in windows):
        if ends and start <= ends[-1]:
            ends[-1] = max(ends[-1], end)
        else:
            starts.append(start)
            ends.append(end)

    def is_in(cdr: bytes) -> bool:
        stamp_ns = header_stamp(cdr)
        k = bisect_right(starts, stamp_ns) - 1
        return k >= 0 and stamp_ns <= ends[k]

    return is_in
