"""Generators of problems, each with a path that is known to be free."""
