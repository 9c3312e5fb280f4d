"""Studies: their cases on a Dask cluster, their tables of plans; workers need no ROS."""
