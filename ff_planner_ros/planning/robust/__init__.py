"""Robust plans: constraint back-off for model and start errors."""
