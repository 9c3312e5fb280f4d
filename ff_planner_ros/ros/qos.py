"""Quality of service of every topic, from parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.settings import tunable

_RELIABILITY = {
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "reliable": ReliabilityPolicy.RELIABLE,
}
_DURABILITY = {
    "volatile": DurabilityPolicy.VOLATILE,
    "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
}
_MAX_DEPTH = 10_000

# Whoever comes late still gets the last one.
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM_QOS = QoSProfile(depth=10)
STATE_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
EVENT_QOS = QoSProfile(depth=100)


@dataclass(frozen=True)
class SubscriptionQos:
    """What the node asks of publishers."""

    reliability: str = tunable(
        "best_effort hears every publisher; reliable does not connect to publishers that "
        "offer best_effort, and only a warning in the log tells"
    )
    durability: str = tunable(
        "volatile hears every publisher, from now on; transient_local also hears what was "
        "published before, but does not connect to publishers that offer volatile, and only a "
        "warning in the log tells"
    )
    depth: int = tunable(
        "Messages that wait at most; the oldest are dropped", minimum=1, maximum=_MAX_DEPTH
    )


@dataclass(frozen=True)
class PublisherQos:
    """What the node offers to subscribers."""

    reliability: str = tunable(
        "reliable is heard by every subscriber; best_effort does not connect to subscribers that "
        "ask for reliable, and only a warning in the log tells"
    )
    durability: str = tunable(
        "transient_local is heard by every subscriber, the last messages also by those that come "
        "late; volatile does not connect to subscribers that ask for transient_local, and only a "
        "warning in the log tells"
    )
    depth: int = tunable(
        "Messages that wait at most, and are kept for those that come late",
        minimum=1,
        maximum=_MAX_DEPTH,
    )


@dataclass(frozen=True)
class QosParameters:
    """Of every topic; the parameters under `qos.`.

    Raises:
        InvalidInput: A word that is not known.
    """

    chaser_state: SubscriptionQos
    odometry: SubscriptionQos
    joint_states: SubscriptionQos
    obstacles: SubscriptionQos
    joint_trajectory: PublisherQos
    predicted_chaser_path: PublisherQos
    predicted_chaser_pose: PublisherQos

    def __post_init__(self) -> None:
        """Check every word."""
        for item in fields(self):
            topic = getattr(self, item.name)
            _policy(f"qos.{item.name}.reliability", topic.reliability, _RELIABILITY)
            _policy(f"qos.{item.name}.durability", topic.durability, _DURABILITY)


def qos_profile(topic: SubscriptionQos | PublisherQos) -> QoSProfile:
    """Return the profile that the parameters of a topic describe.

    Args:
        topic: One field of `QosParameters`.
    """
    return QoSProfile(
        reliability=_RELIABILITY[topic.reliability],
        durability=_DURABILITY[topic.durability],
        depth=topic.depth,
    )


def _policy(field: str, word: str, policies: Mapping[str, object]) -> None:
    if word not in policies:
        raise InvalidInput(
            Status.OUT_OF_RANGE, field, repr(word), f"it must be {' or '.join(policies)}"
        )
