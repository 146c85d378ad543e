"""Calibration files: one reader per format.

A reader refuses with a ``CalibrationError``, or with an ``InputError`` that ``calibration_errors``
turns into one: one sentence naming the file, the key and the reason.
"""
