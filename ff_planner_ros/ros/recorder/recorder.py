"""Records serialised messages to a bag, independently of what the node is doing."""

from __future__ import annotations

import threading
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from ff_planner_ros.bag.mcap.rosbag2_metadata import QualityOfService
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.common.shown import in_log
from ff_planner_ros.errors import BagError
from ff_planner_ros.ros.inputs.raw_subscription import RawSubscription, Taken
from ff_planner_ros.ros.messages.interfaces import type_name

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


@dataclass(frozen=True)
class RecorderHealth:
    """State of the recording."""

    bag: str  # its directory
    messages: int  # number in the bag
    # Number of messages of each topic that are missing; topics without any are left out
    dropped: Mapping[str, int]
    failure: str  # why it has stopped; empty while it goes on


class Recorder:
    """Writes arrived messages to a bag, in a thread of its own, until it is closed.

    Messages wait in the queues of DDS, which has threads of its own. So a message costs the node
    nothing when it comes, and little when many are taken at once.
    """

    def __init__(
        self,
        open_bag: Callable[[], BagWriter],
        directory: Path,
        topics: Sequence[RecordedTopic],
        flush_interval: float,
        node_name: str,
        namespace: str,
        logger: RcutilsLogger,
    ) -> None:
        """Start to record; if the bag cannot be opened, `health` says so.

        Name and namespace are those of the recorder's own node; a crash loses at most what came
        in the last flush_interval [s].
        """
        self._directory, self._logger = directory, logger
        self._lock = threading.RLock()
        self._bag: BagWriter | None = None
        self._failure = ""
        self._dropped: Counter[str] = Counter()
        self._queues: list[_TopicQueue] = []
        self._unwanted: dict[str, Callable[[int], bool]] = {}
        # Names are resolved and the bag's clock is the host's: no argument of the process,
        # remapping and simulated time included, is meant for this node.
        self._node = Node(
            node_name,
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        with self._ending_on_failure():
            self._bag = open_bag()
            self._remember()
            for topic in topics:
                self._bag.add_topic(
                    topic.name, type_name(topic.message_type), [offered_qos(topic.qos)]
                )
            latched = DurabilityPolicy.TRANSIENT_LOCAL
            latched_first = sorted(topics, key=lambda topic: topic.qos.durability != latched)
            self._queues = [_TopicQueue(self._node, topic) for topic in latched_first]
        # Twice as often as promised, so that taking and writing may take time, too.
        self._period = flush_interval / 2
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def health(self) -> RecorderHealth:
        """State of the recording; read without waiting for the disk, perhaps amid a batch."""
        return RecorderHealth(
            bag=str(self._directory),
            messages=self._bag.message_count if self._bag is not None else 0,
            dropped=dict(self._dropped),
            failure=self._failure,
        )

    @property
    def listens(self) -> bool:
        """Whether it hears its topics; not if the bag could not be opened."""
        return bool(self._queues)

    def leave_out(self, topic: str, is_unwanted: Callable[[int], bool]) -> None:
        """Leave out a topic's messages if `is_unwanted` is true for their time of arrival [ns]."""
        self._unwanted[topic] = is_unwanted

    def split(self) -> str:
        """Complete the current file, go on in another one, and return a sentence on both.

        Raises:
            BagError: Recording has stopped.
        """
        with self._lock:
            self._take_all()
            if self._bag is None or self._failure:
                raise BagError(f"recording has stopped: {self._failure}")
            try:
                complete, current = self._bag.split()
            except BagError as error:
                self._fail(str(error))
                raise
        message = f"{complete} is complete, recording goes on in {current.name}"
        self._logger.info(message)
        return message

    def close(self) -> None:
        """Record what has arrived by now, then close the bag."""
        self._stopped.set()
        self._thread.join()
        with self._lock:
            self._take_all()
            if self._bag is not None:
                with self._ending_on_failure():
                    self._bag.close()
        self._node.destroy_node()

    @contextmanager
    def _ending_on_failure(self) -> Iterator[None]:
        """Turn an error of the bag into the end of recording."""
        try:
            yield
        except BagError as error:
            self._fail(str(error))

    def _run(self) -> None:
        while not self._stopped.wait(self._period):
            try:
                self._take_all()
            except Exception as error:
                # The end of a thread would not be noticed.
                self._logger.error(in_log(traceback.format_exc()))
                self._fail(f"{type(error).__name__}: {error}")
                return

    def _take_all(self) -> None:
        """Bring everything that has arrived to the disk."""
        with self._lock:
            arrived = {queue.topic: queue.take() for queue in self._queues}
            self._drop({topic: missing for topic, (_, missing) in arrived.items() if missing})
            messages = [
                (info["received_timestamp"], topic, message, info["source_timestamp"])
                for topic, (taken, _) in arrived.items()
                for message, info in taken
            ]
            for received, topic, message, sent in sorted(messages, key=itemgetter(0)):
                if topic in self._unwanted and self._unwanted[topic](received):
                    continue
                # A publisher of another vendor need not stamp its messages.
                self._keep(topic, message, received, sent if sent > 0 else received)
            if self._bag is not None and not self._failure:
                with self._ending_on_failure():
                    self._bag.flush()

    def _drop(self, counts: Mapping[str, int]) -> None:
        self._dropped.update(counts)
        if counts and not self._failure:
            self._remember()
            self._logger.error(
                "the recorder was too slow, and messages are not in the bag: "
                f"{_listed(counts)}; {self._dropped.total()} since the start"
            )

    def _keep(self, topic: str, message: bytes, received_ns: int, published_ns: int) -> None:
        if self._bag is None or self._failure:
            self._dropped[topic] += 1
        else:
            try:
                self._bag.write(topic, message, received_ns, published_ns)
            except BagError as error:
                self._dropped[topic] += 1
                self._fail(str(error))

    def _fail(self, reason: str) -> None:
        """Say once why recording has stopped; planning goes on."""
        self._failure = reason
        self._logger.error(
            f"recording has stopped, planning goes on: {in_log(reason)}. Once that is set right, "
            "clean up and configure the node, or restart it: a new bag is begun"
        )

    def _remember(self) -> None:
        """Put what is missing into the bag's metadata."""
        if self._bag is None:
            return
        counts = {f"dropped {topic}": str(count) for topic, count in sorted(self._dropped.items())}
        self._bag.custom_data |= {"dropped": str(self._dropped.total()), **counts}


def offered_qos(qos: QoSProfile) -> QualityOfService:
    """Return a quality of service as rosbag2 records it."""
    return QualityOfService(
        depth=qos.depth,
        reliability=qos.reliability.name.lower(),
        durability=qos.durability.name.lower(),
    )


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} of {topic}" for topic, count in sorted(counts.items()))


class _TopicQueue:
    """The waiting messages of a topic, and how many others were lost."""

    def __init__(self, node: Node, topic: RecordedTopic) -> None:
        """Listen from now on; the node need not be spun."""
        self.topic = topic.name
        self._followed: dict[int, None] = {}  # the last number of each publisher, oldest first
        queued = QoSProfile(
            depth=_QUEUE, reliability=topic.qos.reliability, durability=topic.qos.durability
        )
        self._subscription = RawSubscription(node, topic.message_type, topic.name, queued)

    def take(self) -> tuple[list[Taken], int]:
        """Return the waiting messages, and how many others were lost.

        Counted by the sequence numbers of the publishers; exact if only one publisher has sent too
        much. Some middleware has no sequence numbers: then the count is 1 if the queue was full.
        """
        messages = self._subscription.take()
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
