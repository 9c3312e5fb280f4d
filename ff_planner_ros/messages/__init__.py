"""Messages decoded without ROS, of a bag or live."""
