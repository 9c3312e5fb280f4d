"""Trajectory planning service for free-floating space manipulators."""
