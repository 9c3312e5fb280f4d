"""Recorded runs: read, replayed, asked what if, played back."""
