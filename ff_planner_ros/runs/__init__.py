"""Recorded runs: read, replayed, asked what if, reported, played back."""
