"""Families of paths, and the first guesses of each."""
