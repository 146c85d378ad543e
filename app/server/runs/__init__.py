"""Runs: keeping one, and everything that is asked of kept ones."""
