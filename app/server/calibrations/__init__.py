"""Stored calibrations: uploaded, made here, checked, exported."""
