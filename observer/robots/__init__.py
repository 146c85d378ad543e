"""Robots that are driven: one contract, one driver per protocol, the models that are known."""
