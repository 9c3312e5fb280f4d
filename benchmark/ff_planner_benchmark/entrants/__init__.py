"""Methods that take part in the contest."""
