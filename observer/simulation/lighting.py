"""Light of the lab: lamps above, and a window to the left."""

from __future__ import annotations

import numpy as np

from observer.simulation.polygons import FloatArray

_WINDOW = np.array([-0.6, 0.8])


def light(normal: FloatArray) -> FloatArray:
    """Return (...) brightness of surfaces with normals (..., 3), room frame."""
    up = np.maximum(0.0, normal[..., 2])
    side = 0.86 + 0.14 * (normal[..., :2] @ _WINDOW)
    return np.asarray((1 - up) * side + up * 1.06)
