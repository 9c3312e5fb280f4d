"""A subscription whose messages are taken as bytes when somebody asks for them."""

from __future__ import annotations

from typing import Any, TypeAlias

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.ros.topics import Endpoint

# A serialised message, and what the middleware knows of it.
Taken: TypeAlias = tuple[bytes, dict[str, Any]]


class _Unspun(ReentrantCallbackGroup):
    """A group that the executor ignores: with Fast DDS every message would wake it for nothing."""

    def can_execute(self, _: Any) -> bool:
        return False


class RawSubscription:
    """A subscription whose messages wait in DDS, which fills its queue in threads of its own.

    So a message costs no time of Python when it comes, and the executor does not wake up.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        qos: QoSProfile,
        overrides: QoSOverridingOptions | None = None,
    ) -> None:
        """Listen from now on; at most `qos.depth` messages wait, the newest ones."""
        self._node, self.qos = node, qos  # which rclpy changes as overrides say
        self._subscription = node.create_subscription(
            message_type,
            topic,
            lambda _: None,
            qos,
            callback_group=_Unspun(),
            # Events share a condition with the messages, and would wake the executor, too.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=overrides,
            raw=True,
        )

    def take(self) -> list[Taken]:
        """Return the messages that wait, the oldest first, as (bytes, message info)."""
        handle, message_type = self._subscription.handle, self._subscription.msg_type
        messages = list[Taken]()
        with handle:
            while len(messages) < self.qos.depth:
                taken = handle.take_message(message_type, True)
                if taken is None:
                    break
                messages.append(taken)
        return messages

    def close(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)


def deserialised(message: bytes, topic: Endpoint) -> Any:
    """Return a message of a topic from its bytes.

    Raises:
        InvalidInput: The message is damaged.
    """
    try:
        return deserialize_message(message, topic.message_type)
    except RuntimeError:  # what rclpy raises has no narrower public name
        allowed = f"it must be of type {topic.message_type.__name__}"
        raise InvalidInput(Status.OUT_OF_RANGE, topic.name, "damaged", allowed) from None
