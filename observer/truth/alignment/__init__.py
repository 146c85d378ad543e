"""Alignment of motion capture, which has its own room frame and clock, with one run.

It is pure: arrays in, arrays out. The entry point is ``alignment.align``; its result is used via
``aligned.AlignedTruth``. ``online.OnlineAlignment`` does the same during a run.
"""
