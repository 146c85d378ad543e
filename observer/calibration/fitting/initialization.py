"""First guesses for an adjustment: a lens and poses from one camera, the pair from many poses."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.calibration.fitting.adjustment import Adjusted, Corners, StereoModel, adjust
from observer.calibration.fitting.lens import Lens
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array

# Focal lengths to try, as shares of the image's width: fields of view of 90 to 14 degrees, and of
# 180 to 44.
_FOCAL_SHARES: dict[DistortionModel, tuple[float, ...]] = {
    "radtan": (0.5, 0.8, 1.2, 2.0, 4.0),
    "equidistant": (0.25, 0.35, 0.5, 0.8, 1.3),
}
# Pixels: in first guesses, longer residuals count only in proportion to their length.
FIRST_SOFT_PX = 5.0
_TRIAL_STEPS = 8
# Pixels: a pose of the right camera agrees with another view if it explains it to within the first;
# up to the second, if all views are as bad.
_AGREES_PX, _AGREES_AT_MOST_PX = 10.0, 25.0


def begin_camera(
    corners: Corners,
    views: int,
    distortion_model: DistortionModel,
    size: tuple[int, int],
    free: NDArray[np.bool_],
) -> Adjusted:
    """Return rough estimates of one camera's lens and of the poses of the board.

    Several focal lengths are tried, because a board that subtends a small angle says little about
    it at first, and a start from far off ends in a local minimum.

    Args:
        views: number of views; those without corners keep a meaningless pose.
        size: width and height of the images, pixels.
        free: (4 + N,) which values of the lens are estimated.

    Raises:
        CalibrationError: no focal length explains the views at all.
    """
    focal_only = np.zeros_like(free)
    # fx, fy and the first radial term: without it, strong distortion passes for focal length.
    focal_only[[0, 1, 4]] = True
    best: Adjusted | None = None
    least = np.inf
    for share in _FOCAL_SHARES[distortion_model]:
        lens = Lens.ideal(distortion_model, share * size[0], *size)
        # Before there are poses, the board is a metre in front of the camera.
        ahead = np.tile(np.eye(3), (views, 1, 1)), np.tile([0.0, 0.0, 1.0], (views, 1))
        model = StereoModel(size, (lens,), focal_only, np.eye(3), np.zeros(3), *ahead)
        model = with_poses(model, 0, corners)
        found = adjust(model, [corners], soft_px=FIRST_SOFT_PX, iterations=_TRIAL_STEPS)
        length = np.linalg.norm(found.residuals[0], axis=1)
        cost = float(np.minimum(length, 10 * FIRST_SOFT_PX).sum())
        if np.isfinite(cost) and cost < least:
            best, least = found, cost
    if best is None:
        raise CalibrationError(
            "no lens model fits the views of the board; check the number of corners of the board"
        )
    model = replace(best.model, free=free)
    found = adjust(model, [corners], soft_px=FIRST_SOFT_PX)
    # With the lens known, a pose that started in the mirrored solution finds the right one.
    again = with_poses(found.model, 0, corners)
    return adjust(again, [corners], soft_px=FIRST_SOFT_PX)


def with_poses(model: StereoModel, camera: int, corners: Corners) -> StereoModel:
    """Return the model with T_left_board of each view as estimated from this camera alone.

    Two poses explain a flat board almost equally well (Collins and Bartoli: Infinitesimal
    Plane-based Pose Estimation, 2014); the better one is used. If there is none, the old one stays.
    """
    board_R, board_t = model.board_R.copy(), model.board_t.copy()
    looks = model.lenses[camera].directions(corners.px)
    for view in np.unique(corners.view):
        rows = (corners.view == view) & np.isfinite(looks).all(axis=1)
        pose = _pose(corners.on_board[rows], looks[rows, :2])
        if pose is None:
            continue
        R, t = pose
        if camera == 1:
            R, t = model.R.T @ R, model.R.T @ (t - model.T)
        board_R[view], board_t[view] = R, t
    return replace(model, board_R=board_R, board_t=board_t)


def begin_pair(
    left: StereoModel, right: StereoModel, corners: tuple[Corners, Corners], both: NDArray[np.bool_]
) -> tuple[StereoModel, NDArray[np.bool_]]:
    """Return the pair from two separately fitted cameras, and which views (V,) agree on it.

    Each view in ``both`` (V,) gives a pose of the right camera. The one that most others agree with
    is used, so that views in which something moved, or corners were numbered the other way round,
    have no influence.
    """
    shown = np.flatnonzero(both)
    R = np.einsum("vij,vkj->vik", right.board_R, left.board_R)
    T = right.board_t - np.einsum("vij,vj->vi", R, left.board_t)
    seen = corners[1].of_views(both)
    place = np.einsum("nij,nj->ni", left.board_R[seen.view], seen.on_board)
    place += left.board_t[seen.view]
    best, least, errors = shown[0], np.inf, np.full(len(both), np.inf)
    for view in shown:
        px, _, _ = right.lenses[0].project(place @ R[view].T + T[view])
        apart = np.nan_to_num(np.sum((seen.px - px) ** 2, axis=1), nan=1e8, posinf=1e8)
        count = np.bincount(seen.view, minlength=len(both))
        rms = np.sqrt(np.bincount(seen.view, apart, len(both)) / np.maximum(count, 1))
        score = float(np.minimum(rms[shown], 5 * _AGREES_PX).sum())
        if score < least:
            best, least, errors = view, score, rms
    limit = float(np.clip(3 * np.median(errors[shown]), _AGREES_PX, _AGREES_AT_MOST_PX))
    # Views that only the right camera has take their poses from it.
    board_R, board_t = left.board_R.copy(), left.board_t.copy()
    only_right = np.isin(np.arange(len(both)), corners[1].view)
    only_right &= ~np.isin(np.arange(len(both)), corners[0].view)
    board_R[only_right] = R[best].T @ right.board_R[only_right]
    board_t[only_right] = (right.board_t[only_right] - T[best]) @ R[best]
    lenses = left.lenses + right.lenses
    model = replace(left, lenses=lenses, R=R[best], T=T[best], board_R=board_R, board_t=board_t)
    return model, both & (errors <= limit)


def _pose(on_board: Float64Array, look: Float64Array) -> tuple[Float64Array, Float64Array] | None:
    if len(on_board) < 4:
        return None
    try:
        _, rvecs, tvecs, errors = cv2.solvePnPGeneric(
            on_board.reshape(-1, 1, 3), look.reshape(-1, 1, 2), np.eye(3), np.zeros(4),
            flags=cv2.SOLVEPNP_IPPE,
        )  # fmt: skip
    except cv2.error:
        return None  # corners on one line, for example
    # OpenCV may return an error value even if it finds no pose.
    for k in np.argsort(np.asarray(errors).ravel()[: len(rvecs)]):
        R = np.asarray(cv2.Rodrigues(rvecs[k])[0], dtype=np.float64)
        t = np.asarray(tvecs[k], dtype=np.float64).reshape(3)
        # The whole board must lie in front of the camera.
        if np.isfinite(R).all() and (on_board @ R[2] + t[2] > 0).all():
            return R, t
    return None
