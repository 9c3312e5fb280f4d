"""Baselines: what plans without optimisation, or without the chaser's true motion, come to."""
