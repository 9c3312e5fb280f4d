"""Judges answers to the data set's scenarios; shares no code with the planner."""
