"""Processes of the server and their communication, independent of the payload.

Latest values in shared memory, ordered messages over a socket pair, supervised child processes, and
workers that run jobs.
"""
