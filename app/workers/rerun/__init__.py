"""Process that observes a run's recording once more and exits.

It is separate from the engine so that neither the open source nor the parameters in force change,
and yields to both.
"""
