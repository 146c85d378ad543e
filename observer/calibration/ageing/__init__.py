"""Whether a calibration still fits the cameras: watched during runs, set right where it can be.

Rows tell pitch and roll between the cameras apart from the scene (``row_drift`` watches them,
``row_refinement`` sets them straight); vergence looks like depth, and only a known way tells it
(``vergence``).
"""
