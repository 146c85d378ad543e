"""Process that observes one pair of frames after another, and draws the steps of the method.

It stays for a while, with the source open and the last pairs observed, so that a page can follow a
slider. It is separate from the engine so that neither the open source nor the parameters in force
change, and yields to both.
"""
