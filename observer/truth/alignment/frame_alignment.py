"""Rigid transform between two frames from points known in both, where the vertical is known.

It is Umeyama's method without scale (Least-squares estimation of transformation parameters between
two point patterns, 1991); outliers are gradually down-weighted by the Geman-McClure function, whose
width shrinks to the noise (graduated non-convexity, Blake and Zisserman, 1987).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.errors import NotObservable
from observer.geometry import Float64Array, Pose

# Points with a smaller RMS spread do not determine a direction.
MIN_SPREAD_M = 0.15
_LEAST_SCALE_M = 0.002
_ROUNDS = 25


def align_planar(
    source: Float64Array, target: Float64Array, up_source: Float64Array, up_target: Float64Array
) -> tuple[Pose, float]:
    """Find yaw and translation, where the vertical (3,) is known in both frames.

    Heights are matched by their median difference: motion on the ground reveals no more.

    Args:
        source, target: (N, 3) metres, the same points; rows with NaN are left out.

    Returns:
        ``T_target_source``, and the RMS distance of the inliers in the ground plane, metres.

    Raises:
        NotObservable: the points lie too close together.
    """
    source, target = _both(source, target)
    to_source, to_target = upright(up_source), upright(up_target)
    a, b = source @ to_source.T, target @ to_target.T
    _check_spread(a[:, :2])

    def fit(weights: Float64Array) -> Pose:
        ca, cb = weights @ a / weights.sum(), weights @ b / weights.sum()
        da, db = (a - ca)[:, :2], (b - cb)[:, :2]
        sine = weights @ (da[:, 0] * db[:, 1] - da[:, 1] * db[:, 0])
        cosine = weights @ (da * db).sum(axis=1)
        R = Pose.from_rotvec([0, 0, np.arctan2(sine, cosine)], np.zeros(3)).rotation
        moved = cb - R @ ca
        return Pose(R, np.array([moved[0], moved[1], float(np.median(b[:, 2] - a[:, 2]))]))

    level, weights = _robust(fit, a, b)
    T = Pose(to_target.T, np.zeros(3)) @ level @ Pose(to_source, np.zeros(3))
    # Inliers: at weight one quarter the error equals the width, three times the median error.
    apart = (b - level.apply(a))[weights > 0.25, :2]
    return T, float(np.sqrt((apart**2).sum(axis=1).mean()))


def upright(up: Float64Array) -> Float64Array:
    """Return the shortest rotation (3, 3) that brings a vertical (3,) onto z."""
    up = np.asarray(up, np.float64) / np.linalg.norm(up)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if up[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return Pose.from_rotvec(axis / sine * np.arctan2(sine, up[2]), np.zeros(3)).rotation


def _both(source: Float64Array, target: Float64Array) -> tuple[Float64Array, Float64Array]:
    known = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < 3:
        raise NotObservable(
            f"only {int(known.sum())} positions are known in both coordinate frames, too few to "
            "align them; at least 3 are needed"
        )
    return source[known], target[known]


def _check_spread(points: Float64Array) -> None:
    """Refuse points (N, 2) that do not spread enough in any direction."""
    spread = np.linalg.svd(points - np.median(points, axis=0), compute_uv=False)[0]
    spread = spread / np.sqrt(len(points))
    if spread < MIN_SPREAD_M:
        raise NotObservable(
            f"the common positions lie within {spread:.2f} m of each other, too close to determine "
            "a direction; let the body drive further"
        )


def _robust(
    fit: Callable[[Float64Array], Pose], a: Float64Array, b: Float64Array
) -> tuple[Pose, Float64Array]:
    """Return the transform and the points' weights; only the first two axes count."""
    weights = np.ones(len(a))
    width = None
    T = fit(weights)
    for _ in range(_ROUNDS):
        error = np.linalg.norm((b - T.apply(a))[:, :2], axis=1)
        scale = max(float(np.median(error)), _LEAST_SCALE_M)
        width = max(float(error.max()), 3 * scale) if width is None else max(width / 1.6, 3 * scale)
        weights = (width**2 / (width**2 + error**2)) ** 2
        T = fit(weights)
    return T, weights
