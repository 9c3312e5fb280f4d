"""Methods to compare the planner with: no optimisation, or another belief about the chaser."""
