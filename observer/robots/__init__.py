"""Robots to drive: one contract, one driver per protocol, the known models."""
