"""Collision geometry: the bodies of a robot, and the pairs that must not touch."""
