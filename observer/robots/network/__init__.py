"""Robots of your own that connect to this server over TCP."""
