"""Bags: MCAP files in the rosbag2 layout."""

from ff_planner_ros.bag.plans import RecordedPlan, read_plans

__all__ = ["RecordedPlan", "read_plans"]
