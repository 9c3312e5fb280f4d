"""Methods to compare the planner with: no optimisation, or another belief about the chaser."""

OPTIMAL, STRAIGHT, APF = "optimal", "straight", "apf"
FIXED_BASE, ZERO_MOMENTUM = "fixed_base", "zero_momentum"
METHODS = (OPTIMAL, STRAIGHT, APF, FIXED_BASE, ZERO_MOMENTUM)  # the first one is the planner's own
