"""Requests: read, taken up one at a time, planned in a process of their own, answered."""
