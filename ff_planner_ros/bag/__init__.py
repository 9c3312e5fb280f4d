"""Bags: MCAP files in the rosbag2 layout."""
