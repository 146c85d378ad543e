"""Driving through a running server as one of its operators, for the command line."""
