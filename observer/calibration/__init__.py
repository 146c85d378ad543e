"""Calibrations: boards and their detection, the fit, how good it is, and how it ages.

``formats`` has one reader for each file format and, where other programs read it too, one writer.
"""
