"""Calibration drift: watched during runs, and corrected where it can be.

Rows tell pitch and roll between the cameras apart from the scene (``row_drift`` watches them,
``row_refinement`` sets them straight); vergence looks like depth, and a way by the wheels tells it
(``vergence``), or near against far points while driving (``driving_errors``, with the skew of the
exposures).
"""
