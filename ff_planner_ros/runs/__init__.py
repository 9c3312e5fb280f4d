"""Recorded runs: read, replayed, asked what if."""
