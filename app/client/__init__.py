"""Driving by a running server, as one of its operators: what the command line does."""
