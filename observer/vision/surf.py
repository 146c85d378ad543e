"""SURF points and descriptors by mahotas, which the extra ``surf`` installs.

OpenCV's wheels do not contain SURF (Bay, Ess, Tuytelaars, Van Gool: Speeded-Up Robust Features,
CVIU 110, 2008). mahotas is imported on first use, so that it is not needed otherwise. Its
orientations scatter by some degrees: on rotated noise its best match was correct for 70 % of the
points at 10 degrees and for 45 % at 30, which does not matter between frames of a video.
"""

from __future__ import annotations

import importlib
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.errors import InputError
from observer.geometry import Float64Array
from observer.parameters.surf_extra import surf_missing

# Least determinant of the Hessian for a point; mahotas' default, which finds no points in noise of
# 2 grey levels and about 1,000 in an image of 512x256.
_THRESHOLD = 0.1
_OCTAVES, _SCALES, _STEP_PX = 4, 6, 1
# mahotas counts scale in sigma of its smallest filter, OpenCV size in pixels across the filter:
# the 9x9 filter stands for a sigma of 1.2.
_PX_PER_SCALE = 9 / 1.2


def surf_points(image: NDArray[np.uint8], most: int) -> tuple[cv2.KeyPoint, ...]:
    """Return at most ``most`` SURF points of a grey (H, W) image, the strongest first.

    ``response`` is the determinant of the Hessian and ``class_id`` the sign of its trace: -1 for
    a bright blob, 1 for a dark one.

    Raises:
        InputError: mahotas is not installed.
    """
    # Rows of y, x, scale, score, sign of the trace.
    found = _mahotas().interest_points(image, _OCTAVES, _SCALES, _STEP_PX, _THRESHOLD, most)
    return tuple(
        cv2.KeyPoint(x, y, scale * _PX_PER_SCALE, -1.0, score, 0, int(sign))
        for y, x, scale, score, sign in found.tolist()
    )


def surf_descriptors(
    image: NDArray[np.uint8], points: tuple[cv2.KeyPoint, ...]
) -> tuple[NDArray[np.float32], Float64Array]:
    """Return the points whose whole patch is in the image, and their descriptors.

    Returns:
        px (N, 2) float32; values (N, 64) of length 1, to be compared by Euclidean distance.

    Raises:
        InputError: mahotas is not installed.
    """
    rows = np.array(
        [[p.pt[1], p.pt[0], p.size / _PX_PER_SCALE, p.response, p.class_id] for p in points]
    ).reshape(-1, 5)
    if len(rows) == 0:
        return np.empty((0, 2), np.float32), np.empty((0, 64))
    # Rows of y, x, scale, score, sign, angle and the 64 values.
    found = np.asarray(_mahotas().descriptors(image, rows), dtype=np.float64)
    # A patch without any gradient has a zero descriptor, NaN once normalised.
    found = found[np.isfinite(found).all(axis=1)]
    return found[:, 1::-1].astype(np.float32), found[:, 6:]


def _mahotas() -> Any:
    missing = surf_missing()
    if missing is not None:
        raise InputError(missing)
    return importlib.import_module("mahotas.features.surf")
