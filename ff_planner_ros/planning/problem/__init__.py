"""What is asked: the start, the goal, what is in the way, what is minimised and what is kept."""
