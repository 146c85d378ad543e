"""Benchmark of driving to a goal among people."""
