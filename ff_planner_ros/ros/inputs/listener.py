"""Subscriptions that a thread of their own polls, however busy the node's executor is.

rclpy's executor spends a millisecond on each message, this thread a few microseconds. So states at
a high rate do not wait behind requests, markers and large scenes.
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
    """A group that the executor ignores: with Fast DDS every message would wake it for nothing.

    That holds for the events of the subscriptions, too: they share a condition with the messages.
    """

    def can_execute(self, _: Any) -> bool:
        return False


class Listener:
    """Passes every message of its topics to a callback, in order per topic, until closed."""

    def __init__(self, node: Node) -> None:
        """Begin without topics."""
        self._node, self._group = node, _Unspun()
        self._heard: list[tuple[Subscription, Callable[..., None]]] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)

    def add(
        self,
        message_type: type,
        topic: str,
        keep: Callable[..., None],
        qos: QoSProfile,
    ) -> None:
        """Subscribe to a topic.

        Args:
            keep: Called with the bytes of each message and its publication sequence number, which
                is None if the middleware has none.
        """
        subscription = self._node.create_subscription(
            message_type, topic, keep, qos, callback_group=self._group, raw=True
        )
        self._heard.append((subscription, keep))

    def start(self) -> None:
        """Start the thread; no topic may be added after that."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, and destroy the subscriptions."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        for subscription, _ in self._heard:
            self._node.destroy_subscription(subscription)

    def _run(self) -> None:
        looked, period = time.monotonic(), _SILENT
        while not self._stopped.wait(period):
            period = _SILENT
            if time.monotonic() > looked + _EVENTS:
                looked = time.monotonic()
                self._tell_events()
            for subscription, keep in self._heard:
                try:
                    if self._take(subscription, keep):
                        period = _PERIOD
                except Exception:  # of one message; the end of a thread would not be noticed
                    self._node.get_logger().error(in_log(traceback.format_exc()))

    def _tell_events(self) -> None:
        """Tell of publishers that do not fit, as the executor would."""
        handlers: list[EventHandler] = []
        for subscription, _ in self._heard:
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

    def _take(self, subscription: Subscription, keep: Callable[..., None]) -> bool:
        """Hand over what waits, and tell whether anything did."""
        has_come = False
        handle, message_type = subscription.handle, subscription.msg_type
        with handle:
            while not self._stopped.is_set():
                taken = handle.take_message(message_type, True)  # its bytes
                if taken is None:
                    break
                has_come = True
                message, info = taken
                keep(message, info["publication_sequence_number"])
        return has_come
