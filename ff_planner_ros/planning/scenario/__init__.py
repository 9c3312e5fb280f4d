"""Scenario files, which hold a task, and libraries of plans: reading and writing."""
