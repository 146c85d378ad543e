"""Simulated robots: firmware, vehicle, sonar, and how they are reached as real ones are."""
