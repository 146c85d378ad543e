"""Timed velocities for robots, as data."""
