"""Aligns live motion capture in a process of its own.

It takes up to seconds of a core, and neither the engine's loop nor its interpreter may wait for it.
"""
