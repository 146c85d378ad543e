"""Calibrations that are kept: uploaded, made here, checked, exported."""
