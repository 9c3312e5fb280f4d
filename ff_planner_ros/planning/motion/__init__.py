"""Plans, motions of joints and chaser, and their metrics."""
