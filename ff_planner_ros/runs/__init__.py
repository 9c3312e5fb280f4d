"""Recorded runs: their content, replay, and what if."""
