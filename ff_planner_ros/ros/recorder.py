"""Record topics to a bag as they come, byte by byte, undisturbed by what the node is doing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from ff_planner_ros.bag.writer import BagWriter, QualityOfService
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.background import spin_in_background

# A recorder keeps what others, after the newest only, may skip.
_QUEUE = 1000


@dataclass(frozen=True)
class RecordedTopic:
    """A topic to record.

    Attributes:
        name: Resolved, with its leading slash.
        message_type: Its message class.
        qos: What its publishers offer; those that offer less are not heard.
    """

    name: str
    message_type: type
    qos: QoSProfile


class Recorder:
    """Subscribes in a node and thread of its own until it is closed.

    Attributes:
        failure: Why recording has stopped; empty while it goes on.
    """

    def __init__(
        self,
        bag: BagWriter,
        topics: Sequence[RecordedTopic],
        flush_interval: float,
        node_name: str,
        namespace: str,
    ) -> None:
        """Start to record.

        Args:
            bag: Open; closed by `close`.
            topics: What to record.
            flush_interval: A crash loses at most this [s].
            node_name: Name of the recorder's node.
            namespace: Of the recorder's node.

        Raises:
            BagError: The bag cannot take the topics.
        """
        self._bag = bag
        self.failure = ""
        # Names are resolved and the bag's clock is the host's: no argument of the process,
        # remapping and simulated time included, is meant for this node.
        self._node = Node(
            node_name,
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        for topic in topics:
            bag.add_topic(topic.name, type_name(topic.message_type), [offered_qos(topic.qos)])
            write: Any = self._writer(topic.name)  # with raw=True rclpy's types do not fit
            queued = QoSProfile(
                depth=_QUEUE, reliability=topic.qos.reliability, durability=topic.qos.durability
            )
            self._node.create_subscription(topic.message_type, topic.name, write, queued, raw=True)
        self._node.create_timer(
            flush_interval, self._flush, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        self._stop = spin_in_background(executor, self._node.get_logger())

    def close(self) -> None:
        """Record what has arrived by now, then close the bag."""
        self._stop()
        for subscription in self._node.subscriptions:
            handle, message_type = subscription.handle, subscription.msg_type
            with handle:
                while (taken := handle.take_message(message_type, True)) is not None:
                    subscription.callback(*taken)
        self._try(self._bag.close)
        self._node.destroy_node()

    def _writer(self, topic: str) -> Callable[[bytes, dict[str, int]], None]:
        def write(message: bytes, info: dict[str, int]) -> None:
            received = info["received_timestamp"]
            # A publisher of another vendor need not stamp its messages.
            published = info["source_timestamp"] if info["source_timestamp"] > 0 else received
            self._try(lambda: self._bag.write(topic, message, received, published))

        return write

    def _flush(self) -> None:
        self._try(self._bag.flush)

    def _try(self, action: Callable[[], Any]) -> None:
        """Do something to the bag; when it fails say so once, planning goes on."""
        if self.failure:
            return
        try:
            action()
        except BagError as error:
            self.failure = str(error)
            self._node.get_logger().error(f"recording has stopped, planning goes on: {error}")


def type_name(message_type: type) -> str:
    """Return the name of a message class as a bag writes it, `package/msg/Name`."""
    package, kind = message_type.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_type.__name__}"


def offered_qos(qos: QoSProfile) -> QualityOfService:
    """Return a quality of service in the words of rosbag2."""
    return QualityOfService(
        depth=qos.depth,
        reliability=qos.reliability.name.lower(),
        durability=qos.durability.name.lower(),
    )
