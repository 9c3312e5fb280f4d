"""Benchmark: scenarios that have a plan, other methods to compare with, tables."""
