"""Rotations by quaternions as files write them: scalar last, rounded, absent in gaps."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from observer.geometry import Float64Array

# Files round to three digits and more.
_UNIT_WITHIN = 1e-2


def quaternion_rotations(xyzw: Float64Array) -> tuple[Float64Array, NDArray[np.bool_]]:
    """``R_room_body`` (N, 3, 3) by quaternions (N, 4), scalar last; NaN where a number is.

    The second array (N,) says which are no unit quaternions, those with NaN left out; their
    rotations are NaN.
    """
    matrices = np.full((len(xyzw), 3, 3), np.nan)
    known = np.isfinite(xyzw).all(axis=1)
    with np.errstate(over="ignore"):
        lengths = np.sqrt((xyzw * xyzw).sum(axis=1))
    unit = known & (np.abs(lengths - 1) <= _UNIT_WITHIN)
    if unit.any():
        matrices[unit] = scipy.spatial.transform.Rotation.from_quat(xyzw[unit]).as_matrix()
    return matrices, np.asarray(known & ~unit)
