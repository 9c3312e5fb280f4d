"""What each command of `ff-planner` does; a command that needs ROS imports it itself."""
