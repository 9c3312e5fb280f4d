"""The numerics that a search spends its time in, in C++; the check uses none of them."""
