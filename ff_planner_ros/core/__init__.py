"""The numerics that a search repeats, in C++; the check uses none of them."""
