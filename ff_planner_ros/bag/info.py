"""What is in a bag, on one screen."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from ff_planner_ros.bag.mcap_records import printable
from ff_planner_ros.bag.plans import (
    GOAL_EVENT,
    REQUEST_RECEIVED,
    SERVICE_EVENT,
    RecordedPlan,
    is_event,
    recorded_plans,
)
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.bag.rosbag2_metadata import ROSBAG2, custom_data

_MOST_REQUESTS = 20  # listed one by one: a screen has not many more lines
_LONGEST = 100  # [characters] of a text on a line


def info(path: Path) -> Iterator[str]:
    """Yield what is in a bag, line by line, and at the end what is wrong with it.

    Args:
        path: The directory, or one of its MCAP files.

    Raises:
        BagError: Nothing of the bag can be read.
    """
    with open_bag(path) as bag:
        yield from _extent(bag)
        yield from _topics(bag)
        yield from _requests(bag)
        yield from _documents(bag)
        for note in bag.notes:
            yield f"note: {printable(note)}"


def _extent(bag: Bag) -> Iterator[str]:
    yield f"bag       {bag.path}"
    names = ", ".join(file.name for file in bag.files[:3])
    more = f" and {len(bag.files) - 3} more" if len(bag.files) > 3 else ""
    yield f"files     {len(bag.files)}, {bag.size / 1e6:.1f} MB: {_short(names + more)}"
    yield f"library   {_short(bag.library)}"
    if bag.message_count:
        duration = (bag.end_ns - bag.start_ns) * 1e-9
        yield f"recorded  {_utc(bag.start_ns)} to {_utc(bag.end_ns)}, {duration:.3f} s"
    yield f"messages  {bag.message_count}"


def _topics(bag: Bag) -> Iterator[str]:
    yield "topics"
    topics = sorted(bag.topics.values(), key=lambda topic: topic.name)
    width = max((len(topic.name) for topic in topics), default=0)
    for topic in topics:
        name, type_name = _short(topic.name), _short(topic.type_name)
        yield f"  {topic.message_count:9}  {name:{width}}  {type_name}"


def _requests(bag: Bag) -> Iterator[str]:
    plans = recorded_plans(bag)
    asked = _asked(bag)
    planners = sorted({_planner(plan.topic) for plan in plans} | set(asked))
    if len(planners) > 1:
        robots = {planner.rpartition("/")[0] for planner in planners}
        if len(robots) > 1:
            bag.note(
                f"it is of {len(robots)} planners, {', '.join(sorted(robots))}: the robot.urdf "
                "attached is of one of them"
            )
    outcomes = Counter(plan.status for plan in plans)
    unanswered = sum(asked.values()) - len(plans)
    if unanswered > 0:
        outcomes["no answer"] = unanswered
    listed = ", ".join(f"{count} {status}" for status, count in outcomes.most_common())
    yield f"requests  {sum(outcomes.values())}{': ' if listed else ''}{listed}"
    for plan in plans[:_MOST_REQUESTS]:
        yield _request(bag, plan)
    if len(plans) > _MOST_REQUESTS:
        yield f"  ... and {len(plans) - _MOST_REQUESTS} more: ff-planner export has them all"


def _asked(bag: Bag) -> Counter[str]:
    """Return the number of requests and goals that each service and action received."""
    return Counter(
        _planner(message.topic)
        for type_name in (SERVICE_EVENT, GOAL_EVENT)
        for message, event in bag.decoded(type_name)
        if is_event(event, REQUEST_RECEIVED)
    )


def _planner(topic: str) -> str:
    """Return the service or action that an event is of."""
    for ending in ("/_action/send_goal", "/_action/get_result", ""):
        name = topic.removesuffix(f"{ending}/_service_event")
        if name != topic:
            return name
    return topic


def _request(bag: Bag, plan: RecordedPlan) -> str:
    seconds = (plan.answered_ns - bag.start_ns) * 1e-9
    asked = _planner(plan.topic)
    name, message = _short(plan.plan_id), _short(plan.message)
    return f"  {seconds:9.3f} s  {_short(asked)}  {plan.status}  {name}  {message}"


def _documents(bag: Bag) -> Iterator[str]:
    names = (f"{name} ({len(data)} bytes)" for name, data in bag.attachments.items())
    yield f"attached  {_short(', '.join(names)) or 'nothing'}"
    for name, record in bag.metadata.items():
        content = custom_data(record) if name == ROSBAG2 else record
        if content:
            yield _short(name)
            for key, value in content.items():
                yield f"  {_short(key):16}  {_short(value)}"


def _utc(time_ns: int) -> str:
    seconds, nanoseconds = divmod(time_ns, 10**9)
    try:
        whole = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(seconds))
    except (OverflowError, OSError, ValueError):
        return f"{seconds} s"
    return f"{whole}.{nanoseconds // 10**6:03} UTC"


def _short(text: str) -> str:
    return printable(text, _LONGEST)
