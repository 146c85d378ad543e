"""Calibration drift: watched during runs, and corrected where it can be.

Row offsets show pitch and roll between the cameras, whatever the scene (``row_drift`` watches them,
``row_refinement`` corrects them). Vergence looks like depth; it is measured against the distance
driven by the wheels (``vergence``), or by near against far points while driving
(``driving_errors``, with the skew of the exposures).
"""
