"""Alignment of live motion capture in a separate process.

It takes up to seconds of CPU time, and must block neither the engine's loop nor its interpreter.
"""
