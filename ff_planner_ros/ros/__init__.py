"""The ROS 2 node: messages to planning objects and back, clocks, queues, threads."""
