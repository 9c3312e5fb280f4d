"""The messages of a topic that wait to be recorded, as bytes, and how many were lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

# Messages of a topic that wait: at 2 kHz, the disk may stand still for 2.5 s. The most that Fast
# DDS holds: asked for more, it holds as many, and refuses the newest instead of the oldest.
_QUEUE = 5000
# Publishers of a topic whose numbers are remembered; who was heard last is.
_PUBLISHERS = 64


@dataclass(frozen=True)
class RecordedTopic:
    """A topic to record."""

    name: str
    message_type: type
    qos: QoSProfile


class TopicQueue:
    """A subscription whose messages wait in DDS, which fills its queue in threads of its own."""

    def __init__(self, node: Node, topic: RecordedTopic) -> None:
        """Listen from now on; the node need not be spun."""
        self.topic = topic.name
        self._followed: dict[int, None] = {}  # the last number of each publisher, oldest first
        queued = QoSProfile(
            depth=_QUEUE, reliability=topic.qos.reliability, durability=topic.qos.durability
        )
        self._subscription: Subscription = node.create_subscription(
            topic.message_type, topic.name, lambda _: None, queued, raw=True
        )

    def take(self) -> tuple[list[tuple[bytes, dict[str, Any]]], int]:
        """Return the waiting messages, and how many others were lost.

        Counted by the sequence numbers of the publishers; exact if only one publisher has sent too
        much. Some middleware has no sequence numbers: then the count is 1 if the queue was full.
        """
        handle, message_type = self._subscription.handle, self._subscription.msg_type
        messages: list[Any] = []
        with handle:
            while len(messages) < _QUEUE:
                taken = handle.take_message(message_type, True)
                if taken is None:
                    break
                messages.append(taken)
        was_full = len(messages) == _QUEUE
        numbers = [info["publication_sequence_number"] for _, info in messages]
        if None in numbers:
            return messages, int(was_full)
        at_least = int(was_full and not self._followed)
        missing = sum(self._missing(number, was_full) for number in numbers)
        return messages, max(missing, at_least)

    def _missing(self, number: int, was_full: bool) -> int:
        """Return how many messages of its publisher are missing before one."""
        last = number - 1
        if last not in self._followed and was_full:
            last = max((other for other in self._followed if other < number), default=last)
        # Without a full queue nothing is missing: a publisher that has just been found.
        self._followed.pop(last, None)
        self._followed[number] = None
        if len(self._followed) > _PUBLISHERS:
            del self._followed[next(iter(self._followed))]
        return number - 1 - last
