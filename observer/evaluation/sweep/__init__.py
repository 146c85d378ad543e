"""Sweep of combinations of parameters over sources, on the processes of a cluster."""
