"""Quality of service of every topic, from parameters."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ff_planner_ros.parameters.interfaces import PublisherQos, SubscriptionQos

# Whoever comes late still gets the last one.
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM_QOS = QoSProfile(depth=10)
STATE_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
TF_QOS = QoSProfile(depth=100)
# Those who come late hear what became of the last plans.
PLAN_EVENTS_QOS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Whoever comes late, or is slow for a moment, still gets the last ones: a burst of refusals counts
# two for each request, and a plan of 10,000 points takes 5 MB.
EXCHANGES_QOS = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Requests that wait at each of our services and at the action; the middleware drops the oldest of
# more, and nobody answers those. More than a fleet's executives ask at once, and little where none
# wait.
MOST_REQUESTS = 1000
REQUEST_QOS = QoSProfile(depth=MOST_REQUESTS)


def qos_profile(topic: SubscriptionQos | PublisherQos) -> QoSProfile:
    """Return the profile that the parameters of a topic describe."""
    return QoSProfile(
        reliability=ReliabilityPolicy[topic.reliability.upper()],
        durability=DurabilityPolicy[topic.durability.upper()],
        depth=topic.depth,
    )
