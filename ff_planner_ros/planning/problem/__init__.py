"""The request: start, goal, obstacles, objective, limits, settings."""
