"""Service and action, jobs, and the solver's process."""
