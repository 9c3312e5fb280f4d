"""A complete request to the planner, and the way to its answer."""
