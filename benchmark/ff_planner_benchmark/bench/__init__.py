"""How fast, how often and how well the planner and other methods plan."""
