"""Simulated robots: firmware, vehicle and sonar, reached through the ports of real ones."""
