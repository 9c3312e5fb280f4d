"""Summary of a bag, as lines of text and as a JSON document."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ff_planner_ros.bag.mcap.rosbag2_metadata import ROSBAG2, custom_data
from ff_planner_ros.bag.plans import NO_ANSWER, RecordedPlan, recorded_requests
from ff_planner_ros.bag.publications import Publication, publications
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.common.shown import printable
from ff_planner_ros.common.times import NANOSECONDS

_MOST_REQUESTS = 20  # listed one by one: a screen has not many more lines
_LONGEST = 100  # [characters] of a text on a line


def info(path: Path) -> Iterator[str]:
    """Yield the summary of a bag line by line, at the end what is wrong with it.

    Raises:
        BagError: Nothing of the bag can be read.
    """
    yield from _lines(bag_document(path))


def bag_document(path: Path) -> dict[str, Any]:
    """Return the summary of a bag as a JSON document, with answers in order of time.

    Every chunk is read, so that all damage is known.

    Raises:
        BagError: Nothing of the bag can be read.
    """
    with open_bag(path) as bag:
        damaged = bag.damaged_blocks()
        requests = _requests(bag)
        return {
            "bag": str(bag.path),
            "files": [file.name for file in bag.files],
            "size_bytes": bag.size,
            "library": bag.library,
            "start_ns": bag.start_ns,
            "end_ns": bag.end_ns,
            "duration_s": (bag.end_ns - bag.start_ns) / NANOSECONDS,
            "message_count": bag.message_count,
            "topics": [
                {"name": one.name, "type": one.type_name, "message_count": one.message_count}
                for one in bag.topics.values()
            ],
            **requests,
            "publications": [_publication(bag, one) for one in publications(bag)],
            "attached": {name: len(data) for name, data in bag.attachments.items()},
            "records": {
                name: custom_data(record) if name == ROSBAG2 else dict(record)
                for name, record in bag.metadata.items()
            },
            "damaged": [
                {
                    "file": file,
                    "what": "chunk" if block.is_chunk else "message",
                    "offset": block.offset,
                    "length": block.length,
                }
                for file, block in damaged
            ],
            "notes": list(bag.notes),
        }


def _requests(bag: Bag) -> dict[str, Any]:
    """Return the answers, and the number of requests in all and of each status."""
    found = recorded_requests(bag)
    planners = sorted({one.topic.rpartition("/")[0] for one in found})
    if len(planners) > 1:
        bag.note(
            f"it is of {len(planners)} planners, {', '.join(planners)}: the robot.urdf attached "
            "is of one of them"
        )
    counts = Counter(one.status for one in found)
    return {
        "request_count": counts.total(),
        "requests_by_status": dict(counts.most_common()),
        "answers": [_answer(bag, one) for one in found if one.status != NO_ANSWER],
    }


def _answer(bag: Bag, plan: RecordedPlan) -> dict[str, Any]:
    return {
        "interface": plan.interface,
        "requester": plan.requester,
        "plan_id": plan.plan_id,
        "answered_ns": plan.answered_ns,
        "answered_after_s": (plan.answered_ns - bag.start_ns) / NANOSECONDS,
        "status": plan.status,
        "message": plan.message,
        "first_guess": plan.solver.get("first_guess"),
    }


def _publication(bag: Bag, one: Publication) -> dict[str, Any]:
    after = (one.answered_ns - bag.start_ns) / NANOSECONDS
    return vars(one) | {"answered_after_s": after}


def _lines(told: Mapping[str, Any]) -> Iterator[str]:
    yield f"bag       {printable(told['bag'])}"
    names = told["files"]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    listed = ", ".join(map(_short, names[:3])) + more
    yield f"files     {len(names)}, {told['size_bytes'] / 1e6:.1f} MB: {listed}"
    yield f"library   {_short(told['library'])}"
    if told["message_count"]:
        start, end = _utc(told["start_ns"]), _utc(told["end_ns"])
        yield f"recorded  {start} to {end}, {told['duration_s']:.3f} s"
    yield f"messages  {told['message_count']}"
    yield "topics"
    width = max((len(topic["name"]) for topic in told["topics"]), default=0)
    for topic in told["topics"]:
        name, type_name = _short(topic["name"]), _short(topic["type"])
        yield f"  {topic['message_count']:9}  {name:{width}}  {type_name}"
    yield from _request_lines(told)
    yield from _publication_lines(told["publications"])
    documents = (f"{name} ({length} bytes)" for name, length in told["attached"].items())
    yield f"attached  {_short(', '.join(documents)) or 'nothing'}"
    for name, record in told["records"].items():
        if record:
            yield _short(name)
            for key, value in record.items():
                yield f"  {_short(key):16}  {_short(value)}"
    for note in told["notes"]:
        yield f"note: {printable(note)}"


def _request_lines(told: Mapping[str, Any]) -> Iterator[str]:
    counts, answers = told["requests_by_status"], told["answers"]
    listed = ", ".join(f"{count} {status}" for status, count in counts.items())
    yield f"requests  {told['request_count']}{': ' if listed else ''}{listed}"
    for one in answers[:_MOST_REQUESTS]:
        words = "  ".join(_short(one[key]) for key in ("interface", "status", "plan_id", "message"))
        words += f"  first guess: {one['first_guess']}" if one["first_guess"] else ""
        yield f"  {one['answered_after_s']:9.3f} s  {words}"
    if len(answers) > _MOST_REQUESTS:
        yield f"  ... and {len(answers) - _MOST_REQUESTS} more: ff-planner export has them all"


def _publication_lines(publications: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    if not publications:
        return
    counts = Counter(one["status"] for one in publications)
    listed = ", ".join(f"{count} {status}" for status, count in counts.most_common())
    yield f"publish_plan  {len(publications)}: {listed}"
    for one in publications[:_MOST_REQUESTS]:
        words = "  ".join(_short(one[key]) for key in ("status", "plan_id", "message"))
        age, before = one["state_age_s"], one["previous_plan_id"]
        words += "" if age is None else f"  state {age:.3f} s old"
        words += f"  after {_short(before)}" if before else ""
        yield f"  {one['answered_after_s']:9.3f} s  {words}"
    if len(publications) > _MOST_REQUESTS:
        more = len(publications) - _MOST_REQUESTS
        yield f"  ... and {more} more: ff-planner export has them all"


def _utc(time_ns: int) -> str:
    seconds, rest_ns = divmod(time_ns, NANOSECONDS)
    try:
        whole = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(seconds))
    except (OverflowError, OSError, ValueError):
        return f"{seconds} s"
    return f"{whole}.{rest_ns // 10**6:03} UTC"


def _short(text: str) -> str:
    return printable(text, _LONGEST)
