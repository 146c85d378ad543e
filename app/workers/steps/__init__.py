"""Process that observes one pair of frames after another, and draws the steps of the method.

It keeps running for a while with the source open and the last observed pairs cached, so that a page
can follow a slider. It is separate from the engine so that neither the open source nor the
current parameters change, and runs at a lower priority than the engine and the server.
"""
