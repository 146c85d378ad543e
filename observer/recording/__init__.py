"""Recordings: what happened in a run, as one MCAP file that other tools open."""
