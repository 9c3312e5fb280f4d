"""The subscriptions of the node: the state of the chaser, obstacles and target body."""
