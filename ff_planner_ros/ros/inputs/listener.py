"""Takes what comes in on topics in a thread of its own, however busy the node's executor is.

An executor of rclpy spends a millisecond on each message. Here it is a few microseconds, so that no
state at a high rate waits behind requests, drawings and large scenes.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ff_planner_ros.common.shown import in_log

# Messages wait in the queues of DDS for so long at most [s]: at 1 kHz 20 of the 50 that there is
# room for. Each look costs 40 us, whether there is a message or not, and where nothing comes it is
# looked less often.
_PERIOD, _SILENT = 0.02, 0.05
# So often is looked for publishers that do not fit [s].
_EVENTS = 1.0


class _Unspun(ReentrantCallbackGroup):
    """The executor leaves it alone: with Fast DDS every message would wake it for nothing.

    That holds for the events of the subscriptions, too: they share a condition with the messages.
    """

    def can_execute(self, _: Any) -> bool:
        return False


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
        looked, period = time.monotonic(), _SILENT
        while not self._stopped.wait(period):
            period = _SILENT
            if time.monotonic() > looked + _EVENTS:
                looked = time.monotonic()
                self._tell_events()
            for subscription, keep, numbered in self._heard:
                try:
                    if self._take(subscription, keep, numbered):
                        period = _PERIOD
                except Exception:  # of one message; the end of a thread would not be noticed
                    self._node.get_logger().error(in_log(traceback.format_exc()))

    def _tell_events(self) -> None:
        """Tell of publishers that do not fit, as the executor would."""
        handlers: list[EventHandler] = []
        for subscription, _, _ in self._heard:
            handlers += subscription.event_handlers  # type: ignore[arg-type]
        context = self._node.context.handle
        with ExitStack() as stack:
            for entity in (context, *handlers):
                stack.enter_context(entity)  # type: ignore[arg-type]
            ready = rclpy_implementation.WaitSet(0, 0, 0, 0, 0, len(handlers), context)
            ready.clear_entities()
            for handler in handlers:
                handler.add_to_wait_set(ready)
            ready.wait(0)
            for handler in handlers:
                told = handler.take_data() if handler.is_ready(ready) else None
                if told is not None:
                    handler.callback(told)

    def _take(self, subscription: Subscription, keep: Callable[..., None], numbered: bool) -> bool:
        """Hand over what waits, and tell whether anything did."""
        has_come = False
        handle, message_type = subscription.handle, subscription.msg_type
        with handle:
            while not self._stopped.is_set():
                taken = handle.take_message(message_type, subscription.raw)
                if taken is None:
                    break
                has_come = True
                message, info = taken
                keep(message, *((info["publication_sequence_number"],) if numbered else ()))
        return has_come
