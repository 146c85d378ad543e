"""Calibration files: one reader per format."""
