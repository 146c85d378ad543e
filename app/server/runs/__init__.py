"""Runs: recording one, and all requests about stored ones."""
