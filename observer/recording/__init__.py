"""Recordings: everything that happened in a run, in one MCAP file that other tools can open."""
