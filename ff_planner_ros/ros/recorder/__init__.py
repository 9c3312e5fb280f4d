"""The bag of a running node."""
