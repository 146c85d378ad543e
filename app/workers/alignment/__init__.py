"""Alignment of live motion capture in a separate process.

It takes up to seconds of a core, and neither the engine's loop nor its interpreter may wait for it.
"""
