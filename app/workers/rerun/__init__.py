"""Process that observes a run's recording once more and exits.

It is separate from the engine so that neither the open source nor the parameters in force change.
It runs at a lower priority than the engine and the server.
"""
