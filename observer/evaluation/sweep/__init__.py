"""Sweep of parameter combinations over sources, on the processes of a cluster."""
