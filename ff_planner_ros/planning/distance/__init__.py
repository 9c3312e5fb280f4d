"""Distances of bodies, certified between the points of a motion."""
