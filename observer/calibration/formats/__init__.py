"""Calibration files: one reader per format.

What a reader refuses is a ``CalibrationError``, or an ``InputError`` that ``calibration_errors``
makes one of: one sentence naming the file, the key and the reason.
"""
