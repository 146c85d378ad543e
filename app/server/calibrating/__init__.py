"""Calibration in the browser, and the library of calibrations."""
