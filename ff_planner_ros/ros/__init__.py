"""The ROS 2 node: clocks, queues and threads around the planner."""
