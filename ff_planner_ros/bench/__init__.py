"""Benchmark: scenarios that have an answer, other methods to compare with, tables."""
