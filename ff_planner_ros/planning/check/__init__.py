"""Refuses a plan that breaks a requirement; knows nothing of solver and search."""
