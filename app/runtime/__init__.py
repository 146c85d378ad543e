"""Processes of the server and what passes between them; knows no payload.

Latest values in shared memory, ordered messages over a socket pair, children that are supervised,
and workers that do jobs.
"""
