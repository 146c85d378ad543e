"""Process that re-runs a recording and exits.

It is separate from the engine so that neither the open source nor the current parameters change.
It runs at a lower priority than the engine and the server.
"""
