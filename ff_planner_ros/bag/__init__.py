"""Bags, MCAP files in the layout of rosbag2, written and read without ROS."""

from ff_planner_ros.bag.plans import RecordedPlan, read_plans

__all__ = ["RecordedPlan", "read_plans"]
