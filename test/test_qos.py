"""Quality of service of the node's topics."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from ff_planner_ros.ros.qos import qos_profile
from ff_planner_ros.ros.topics import CHASER_STATE, JOINT_TRAJECTORY


def test_a_profile_says_what_the_table_says() -> None:
    profile = qos_profile(CHASER_STATE)
    assert profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert profile.durability is DurabilityPolicy.VOLATILE
    assert profile.history is HistoryPolicy.KEEP_LAST
    assert profile.depth == CHASER_STATE.qos.depth
    latched = qos_profile(JOINT_TRAJECTORY)
    assert latched.reliability is ReliabilityPolicy.RELIABLE
    assert latched.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert latched.depth == 1
