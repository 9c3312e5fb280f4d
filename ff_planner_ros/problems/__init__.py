"""Generators of planning problems; nearly all come with a motion that solves them, the witness."""
