"""Simulated robots: firmware, vehicle and sonar, reached through ports like real robots."""
