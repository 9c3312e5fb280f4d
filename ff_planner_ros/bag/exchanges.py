"""The requests in a bag, each with its answer and with the task that was planned."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ff_planner_ros.bag.reader import Bag, Message
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages.exchange_words import REFUSED_EARLY, Event, Interface

if TYPE_CHECKING:  # to read a bag's table loads no Pinocchio
    from ff_planner_ros.planning.task.planning_task import PlanningTask

EXCHANGE = "ff_planner_msgs/msg/Exchange"
_TEXT = "std_msgs/msg/String"
WITHOUT_EXCHANGES = f"it holds no {EXCHANGE}, which the node publishes on the topic exchanges"
# What an exchange consists of, beside the request, the task and the answer
_WORDS = ("plan_id", "interface", "requester", "event", "task", "versions")


@dataclass(frozen=True, eq=False)
class Exchange:
    """A request with its answer, as they were recorded."""

    planner: str  # namespace of the planner, without a trailing slash
    topic: str
    plan_id: str
    interface: str  # service, action, replanning or publish_plan
    requester: str
    event: str  # answered, published, rejected or cancelled; received: without an answer
    logged_ns: int  # when the answer, or else the request, was recorded
    request: Any  # as it was decoded; None: one of publish_plan
    answer: Any  # as it was decoded; None: the bag holds no answer
    task: str  # all that the plan depends on, in JSON; empty: refused before it was complete
    versions: str  # of what planned, in JSON
    urdfs: tuple[str, ...]  # of the bag: tasks name them
    asked_ns: int = 0  # when the request came, by the node's clock; zero: not recorded
    answered_ns: int = 0  # when the answer went out, by the node's clock; zero without an answer

    @property
    def status(self) -> Status | None:
        """Status of the answer; None without an answer, or if it is unknown here."""
        if self.answer is None or self.answer.status.code not in iter(Status):
            return None
        return Status(self.answer.status.code)

    def planned_task(self) -> PlanningTask:
        """Return the task that was planned.

        Raises:
            InvalidInput: The bag lacks the task or its URDF, or a value is refused.
        """
        from ff_planner_ros.planning.scenario.task_json import task_from_json, urdf_digest

        if not self.task:
            missing = REFUSED_EARLY
            if self.answer is None:
                missing = "recording, or the planner, ended before its answer"
            raise InvalidInput(Status.OUT_OF_RANGE, "task", "missing", missing)
        return task_from_json(self.task, {urdf_digest(one): one for one in self.urdfs})


def exchanges(bag: Bag) -> Iterator[Exchange]:
    """Yield every request for a plan, in the order of the answers; those without one come last.

    What cannot be understood makes a note.

    Raises:
        BagError: The disk fails.
    """
    for one in _exchanges(bag):
        if one.interface != Interface.PUBLISH_PLAN:
            yield one


def publication_exchanges(bag: Bag) -> Iterator[Exchange]:
    """Yield every request to publish or to reject a plan, as `exchanges` does."""
    word = Interface.PUBLISH_PLAN.encode()
    for one in _exchanges(bag, lambda cdr: word in cdr):
        if one.interface == Interface.PUBLISH_PLAN:
            yield one


def exchange_count(bag: Bag) -> int:
    """Return the number of messages that `exchanges` reads."""
    return sum(one.message_count for one in bag.topics.values() if one.type_name == EXCHANGE)


def _exchanges(bag: Bag, only: Callable[[bytes], bool] | None = None) -> Iterator[Exchange]:
    urdfs = urdfs_in(bag)
    open_ones = dict[tuple[str, ...], Exchange]()
    for message, content in bag.decoded(EXCHANGE, only=only):
        try:
            one = _exchange(message, content, urdfs)
        except (AttributeError, TypeError, ValueError, LookupError, OverflowError) as error:
            bag.note(f"an exchange on {message.topic} cannot be understood: {error}")
            continue
        key = (one.topic, one.interface, one.plan_id)
        if one.event == Event.RECEIVED:
            open_ones[key] = one
        elif one.event != Event.DROPPED:
            before = open_ones.pop(key, None)
            yield one if before is None else replace(one, asked_ns=before.asked_ns)
    yield from open_ones.values()


def _exchange(message: Message, content: Any, urdfs: tuple[str, ...]) -> Exchange:
    words = {name: str(value_at(content, name)) for name in _WORDS}
    at_ns, answer = nanoseconds(content.header.stamp), value_at(content, "answer[0]", None)
    is_request = words["event"] == Event.RECEIVED
    return Exchange(
        planner=message.topic.rpartition("/")[0],
        topic=message.topic,
        logged_ns=message.log_time_ns,
        request=value_at(content, "request[0]", None),
        answer=answer,
        urdfs=urdfs,
        asked_ns=at_ns if is_request else 0,
        answered_ns=0 if is_request else at_ns,
        **words,
    )


def urdfs_in(bag: Bag) -> tuple[str, ...]:
    """Return the URDFs in a bag: attached, or on a topic of texts.

    Raises:
        BagError: The disk fails.
    """
    attached = [one.decode(errors="replace") for one in bag.attachments.values()]
    said = [str(value_at(content, "data", "")) for _, content in bag.decoded(_TEXT)]
    return tuple(dict.fromkeys(one for one in (*attached, *said) if one.startswith("<")))
