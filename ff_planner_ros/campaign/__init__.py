"""Campaigns: cases of a study planned on a Dask cluster, and their tables; workers need no ROS."""
