"""Alignment of motion capture, in its own room and on its own clock, with one run.

Pure: arrays in, arrays out. ``alignment.align`` is the way in, ``aligned.AlignedTruth`` the way
out; ``online.OnlineAlignment`` does the same while a run goes on.
"""
