"""Takes what comes in on topics in a thread of its own, however busy the node's executor is.

An executor of rclpy spends a millisecond on each message. Here it is a few microseconds, so that no
state at a high rate waits behind requests, drawings and large scenes.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

# Messages wait in the queues of DDS for so long at most [s].
_PERIOD = 0.005


class _Unspun(ReentrantCallbackGroup):
    """The executor leaves subscriptions alone; it tells of publishers that do not fit them."""

    def can_execute(self, entity: Any) -> bool:
        return not isinstance(entity, Subscription)


class Listener:
    """Hands over every message of its topics, in the order of each topic, until it is closed."""

    def __init__(self, node: Node) -> None:
        """Begin without topics."""
        self._node, self._group = node, _Unspun()
        self._heard: list[tuple[Subscription, Callable[..., None], bool]] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)

    def add(
        self,
        message_type: type,
        topic: str,
        keep: Callable[..., None],
        qos: QoSProfile,
        *,
        serialised: bool,
        numbered: bool = False,
    ) -> None:
        """Listen to a topic, too; `keep` is given messages, or bytes where they are serialised.

        Args:
            numbered: Whether `keep` is given the number of the publisher, too; None: it gives none.
        """
        subscription = self._node.create_subscription(
            message_type, topic, keep, qos, callback_group=self._group, raw=serialised
        )
        self._heard.append((subscription, keep, numbered))

    def start(self) -> None:
        """Hand over from now on; no topic may be added any more."""
        self._thread.start()

    def close(self) -> None:
        """Stop, and take the subscriptions off the node."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        for subscription, _, _ in self._heard:
            self._node.destroy_subscription(subscription)

    def _run(self) -> None:
        while not self._stopped.wait(_PERIOD):
            for subscription, keep, numbered in self._heard:
                try:
                    self._take(subscription, keep, numbered)
                except Exception:  # of one message; the end of a thread would not be noticed
                    self._node.get_logger().error(traceback.format_exc())

    def _take(self, subscription: Subscription, keep: Callable[..., None], numbered: bool) -> None:
        handle, message_type = subscription.handle, subscription.msg_type
        with handle:
            while not self._stopped.is_set():
                taken = handle.take_message(message_type, subscription.raw)
                if taken is None:
                    return
                message, info = taken
                keep(message, *((info["publication_sequence_number"],) if numbered else ()))
