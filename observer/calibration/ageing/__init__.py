"""Calibration drift: watched during runs, and corrected where it can be.

Rows tell pitch and roll between the cameras apart from the scene (``row_drift`` watches them,
``row_refinement`` sets them straight); vergence looks like depth, and only a known way tells it
(``vergence``).
"""
