"""Selection of the points of a dense disparity map that determine the ground plane."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.types import Image

# Grey levels per pixel: the rms gradient along the row within a block; camera noise alone gives 1.
# With less, semi-global matching guesses from the surroundings, usually too far away.
_LEAST_TEXTURE = 1.5
_BLOCK_PX = 7


def ground_points(
    left: Image, disparity: NDArray[np.float32], camera: StereoCamera
) -> Float64Array:
    """Points of a stereo pair for ``estimate_ground``: those with enough texture to match.

    On a floor with little texture, their plane has about half the error of that of all points.

    Args:
        left: (H, W) grey, rectified. disparity: (H, W) pixels, NaN where unknown, as by
            ``observer.vision.stereo.disparity_map``. camera: on this same pixel grid.

    Returns:
        (N, 3) metres, camera frame.
    """
    gradient = cv2.Scharr(left, cv2.CV_32F, 1, 0) / 32
    texture = cv2.blur(gradient * gradient, (_BLOCK_PX, _BLOCK_PX))
    usable = (texture >= _LEAST_TEXTURE**2) & np.isfinite(disparity) & (disparity > 0)
    v, u = np.nonzero(usable)
    return camera.triangulate(np.stack([u, v], axis=1), disparity[v, u])
