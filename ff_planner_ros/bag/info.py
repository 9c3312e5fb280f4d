"""What is in a bag, on one screen."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from ff_planner_ros.bag.decoding import NANOSECONDS
from ff_planner_ros.bag.mcap_records import printable
from ff_planner_ros.bag.plans import planning_exchanges
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.bag.rosbag2_metadata import ROSBAG2, custom_data

_MOST_REQUESTS = 20  # listed one by one: a screen has not many more lines
_LONGEST = 100  # [characters] of a text on a line


def info(path: Path) -> Iterator[str]:
    """Yield what is in a bag, line by line, and at the end what is wrong with it.

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
    found = planning_exchanges(bag)
    namespaces = sorted({exchange.namespace for exchange in found})
    if len(namespaces) > 1:
        bag.note(
            f"it is of {len(namespaces)} planners, {', '.join(namespaces)}: the robot.urdf "
            "attached is of one of them"
        )
    answered = [(one.name, one.response) for one in found if one.response is not None]
    answered.sort(key=lambda pair: pair[1].answered_ns)
    counts = Counter(plan.status for _, plan in answered)
    # Some recorders do not say which request a response belongs to.
    unanswered = sum(one.request is not None for one in found) - len(answered)
    if unanswered > 0:
        counts["no answer"] = unanswered
    listed = ", ".join(f"{count} {status}" for status, count in counts.most_common())
    yield f"requests  {counts.total()}{': ' if listed else ''}{listed}"
    for name, plan in answered[:_MOST_REQUESTS]:
        seconds = (plan.answered_ns - bag.start_ns) * 1e-9
        plan_id, message = _short(plan.plan_id), _short(plan.message)
        yield f"  {seconds:9.3f} s  {_short(name)}  {plan.status}  {plan_id}  {message}"
    if len(answered) > _MOST_REQUESTS:
        yield f"  ... and {len(answered) - _MOST_REQUESTS} more: ff-planner export has them all"


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
    seconds, rest_ns = divmod(time_ns, NANOSECONDS)
    try:
        whole = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(seconds))
    except (OverflowError, OSError, ValueError):
        return f"{seconds} s"
    return f"{whole}.{rest_ns // 10**6:03} UTC"


def _short(text: str) -> str:
    return printable(text, _LONGEST)
