"""Collision geometry: the bodies of a robot, and the pairs of them that must not touch."""
