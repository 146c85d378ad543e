"""The first two views far enough apart: motion between them and depths, up to scale."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose

_ROTATION_ROUNDS = 8
_ROTATION_WIDTH_RAD = 0.01
_ESSENTIAL_PX = 0.8
_CONFIDENCE = 0.9999
# Share of all points that must lie in front of both cameras.
_LEAST_SHARE = 0.6
_LEAST_POINTS = 20
# Baselines: as far as OpenCV may place a point. Its own limit of 50 drops most of a room's points
# after a short sideways travel; far points are good evidence for the motion.
_FARTHEST = 1e6


@dataclass(frozen=True, eq=False)
class TwoViews:
    """The motion between two views; its length is 1.

    Attributes:
        T_second_first: the motion. inverse: (N,) inverse distance of each point along its first
            line of sight, and sigma: (N,) its standard deviation, in units of 1 / baseline.
        inliers: (N,) which points agree.
    """

    T_second_first: Pose
    inverse: Float64Array
    sigma: Float64Array
    inliers: NDArray[np.bool_]


def turned_between(first: Float64Array, second: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the rotation (3, 3) that best maps lines of sight (N, 3) to the later ones.

    Returns:
        the rotation, and (N,) radians of remaining parallax, which no rotation explains.
    """
    weight = np.ones(len(first))
    R, gap = np.eye(3), np.zeros(len(first))
    for _ in range(_ROTATION_ROUNDS):
        u, _, vt = np.linalg.svd((second * weight[:, None]).T @ first)
        R = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        gap = np.linalg.norm(second - first @ R.T, axis=1)
        weight = 1 / (1 + (gap / _ROTATION_WIDTH_RAD) ** 2)
    return R, gap


def two_views(
    first: Float64Array, second: Float64Array, sigma_rad: float, camera: StereoCamera
) -> TwoViews | None:
    """Estimate the motion between two views from the essential matrix; None if points disagree.

    RANSAC on five-point samples (Nister, PAMI 2004), with OpenCV's own fixed seed, so that equal
    input gives equal results.

    Args:
        first, second: (N, 3) lines of sight of the same points in either camera's axes.
        sigma_rad: noise of a line of sight.
    """
    if len(first) < _LEAST_POINTS:
        return None
    a, b = first[:, :2] / first[:, 2:], second[:, :2] / second[:, 2:]
    E, mask = cv2.findEssentialMat(
        a, b, np.eye(3), method=cv2.RANSAC, prob=_CONFIDENCE, threshold=_ESSENTIAL_PX / camera.fx
    )
    if E is None or E.shape != (3, 3):
        return None
    # Without the keyword, OpenCV takes the number for the output R and keeps its own limit.
    _, R, t, kept, _ = cv2.recoverPose(
        E, a, b, np.eye(3), distanceThresh=_FARTHEST, mask=mask.copy()
    )
    inliers = np.asarray(kept)[:, 0] > 0
    if inliers.sum() < max(_LEAST_POINTS, _LEAST_SHARE * len(first)):
        return None
    T = Pose(np.asarray(R, np.float64), np.asarray(t, np.float64)[:, 0])
    inverse, sigma = inverse_distances(first, second, T, sigma_rad)
    return TwoViews(T, inverse, sigma, inliers)


def inverse_distances(
    first: Float64Array, second: Float64Array, T_second_first: Pose, sigma_rad: float
) -> tuple[Float64Array, Float64Array]:
    """(N,) inverse distance along the first lines of sight (N, 3), and (N,) its sigma."""
    across = np.cross(second, T_second_first.translation)
    turned = np.cross(second, T_second_first.rotate(first))
    lever = np.maximum((across**2).sum(axis=1), 1e-12)
    inverse = -(across * turned).sum(axis=1) / lever
    return inverse, sigma_rad / np.sqrt(lever)
