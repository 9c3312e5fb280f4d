"""What moves: plans, motions of joints and chaser, and how good they are."""
