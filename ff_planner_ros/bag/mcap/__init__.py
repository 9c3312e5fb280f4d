"""MCAP files in the layout of rosbag2, byte by byte, and messages by the definitions in them."""
