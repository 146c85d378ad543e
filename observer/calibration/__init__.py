"""Calibrations: their files, one reader per format."""
