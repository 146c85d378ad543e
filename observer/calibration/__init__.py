"""Calibrations: boards and how they are seen, the fit, how good it is, and how it ages.

``formats`` has one reader and, where others read it too, one writer for each file format.
"""
