"""Following points from t to t+dt in both cameras, each from where it is expected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import FollowingParameters
from observer.types import Image

# OpenCV gives the smaller eigenvalue of the mean gradient matrix in 1/1024 (grey levels/px)^2.
_EIGENVALUE_UNIT = 1024.0
# Lucas-Kanade ends when it moves less than this, or after so many steps.
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.01)
# Checks start where the answer should be, so that one level below the full image is enough.
_CHECK_LEVELS = 1


@dataclass(frozen=True, eq=False)
class Sightings:
    """Where N followed points are in a new pair.

    Attributes:
        px: (N, 2) float32 pixels, left image. right_px: (N, 2) float32, right image; NaN where
            the point has no match there.
        found: (N,) whether the point was followed in the left image and passed its checks.
        sigma: (N, 2) pixels, one standard deviation of ``px`` and of the match in the right image.
    """

    px: NDArray[np.float32]
    right_px: NDArray[np.float32]
    found: NDArray[np.bool_]
    sigma: NDArray[np.float32]


def follow(
    previous: tuple[Image, Image],
    current: tuple[Image, Image],
    px: NDArray[np.float32],
    right_px: NDArray[np.float32],
    expected_px: NDArray[np.float32],
    expected_disparity: NDArray[np.float32],
    levels: int,
    parameters: FollowingParameters,
) -> Sightings:
    """Follow points by Lucas-Kanade, back again, and around the circle of the four images.

    A point is found if following it back returns to within ``back_check_px`` of its start and its
    surroundings have texture in every direction. Its match in the right image counts if the two
    ways there, left(t) - left(t+dt) - right(t+dt) and left(t) - right(t) - right(t+dt), meet
    within ``circle_px`` (Geiger, Ziegler, Stiller: StereoScan, IV 2011).

    Args:
        previous, current: left and right image (H, W) grey, rectified.
        px, right_px: (N, 2) at t; NaN in ``right_px`` where there is no match, then the circle
            is not closed and the match at t+dt counts alone.
        expected_px, expected_disparity: (N, 2), (N,) where the points should be at t+dt; NaN
            disparities leave the right image out.
        levels: of the pyramid, beyond the full image: how far off the expectation may be.
    """
    count = len(px)
    if count == 0:
        empty = np.zeros((0, 2), np.float32)
        return Sightings(empty, empty, np.zeros(0, np.bool_), empty)
    end, status, residual = _flow(previous[0], current[0], px, expected_px, levels, parameters)
    back, returned, texture = _flow(
        current[0], previous[0], end, px, _CHECK_LEVELS, parameters, want_texture=True
    )
    found = status & returned & _inside(end, current[0], parameters.window_px / 4)
    found &= ((back - px) ** 2).sum(axis=1) <= parameters.back_check_px**2
    found &= residual <= parameters.max_error
    matched, mismatch = match_right(current, end, expected_disparity, parameters)
    known = np.isfinite(right_px[:, 0]) & np.isfinite(matched[:, 0])
    around, status, _ = _flow(
        previous[1], current[1], np.where(known[:, None], right_px, 0.0).astype(np.float32),
        np.where(known[:, None], matched, 0.0).astype(np.float32), _CHECK_LEVELS, parameters,
    )  # fmt: skip
    with np.errstate(invalid="ignore"):
        apart = ((around - matched) ** 2).sum(axis=1) > parameters.circle_px**2
    matched[known & (apart | ~status)] = np.nan
    sigma = np.stack([residual, mismatch], axis=1)
    return Sightings(end, matched, found, _noise_px(sigma, texture[:, None], parameters))


def match_right(
    pair: tuple[Image, Image],
    px: NDArray[np.float32],
    expected_disparity: NDArray[np.float32],
    parameters: FollowingParameters,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where points (N, 2) of the left image are in the right one, (N, 2) float32.

    Also (N,) by how many grey levels their surroundings differ. NaN where it is not known beforehand to within a few pixels, where Lucas-Kanade loses it, and
    where the match lies off the row by more than ``row_px``.
    """
    known = np.isfinite(expected_disparity)
    start = px.copy()
    start[:, 0] -= np.where(known, expected_disparity, 0.0)
    end, status, residual = _flow(pair[0], pair[1], px, start, _CHECK_LEVELS, parameters)
    good = known & status & (residual <= parameters.max_error)
    good &= np.abs(end[:, 1] - px[:, 1]) <= parameters.row_px
    good &= _inside(end, pair[1], 0.0)
    return np.where(good[:, None], end, np.float32(np.nan)), residual


def _noise_px(
    difference: NDArray[np.float32],
    texture: NDArray[np.float32],
    parameters: FollowingParameters,
) -> NDArray[np.float32]:
    """Standard deviation, pixels, of a match by Lucas-Kanade.

    Least squares over a window of n pixels whose gradient is g along the weakest direction knows
    the shift to ``noise / (g sqrt(n))``; a mean absolute difference m of the two windows means a
    noise of ``m sqrt(pi / 2)``. What Lucas-Kanade cannot model comes on top.
    """
    noise = np.sqrt(np.pi / 2) * difference
    side = parameters.window_px | 1
    statistical = noise / np.maximum(side * texture, 1e-3)
    return np.hypot(parameters.noise_factor * statistical, parameters.noise_floor_px)


def as_bright_as(first: Image, second: Image) -> Image:
    """The second image, scaled to the brightness of the first.

    Lucas-Kanade compares grey levels, so that a light that flickers looks like motion to it.
    """
    before, after = cv2.mean(first)[0], cv2.mean(second)[0]
    # Below a grey level the scaling would make the image worse by rounding.
    if min(before, after) < 1 or abs(after - before) < 1:
        return second
    return np.asarray(cv2.convertScaleAbs(second, alpha=before / after), dtype=np.uint8)


def _inside(px: NDArray[np.float32], image: Image, margin: float) -> NDArray[np.bool_]:
    height, width = image.shape
    limits = (width - 1 - margin, height - 1 - margin)
    return np.asarray(((px >= margin) & (px <= limits)).all(axis=1), dtype=np.bool_)


def _flow(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    start: NDArray[np.float32],
    levels: int,
    parameters: FollowingParameters,
    *,
    want_texture: bool = False,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
    """Where points are, whether they were found, and their residual or texture, grey levels(/px)."""
    if len(px) == 0:
        return px.copy(), np.zeros(0, np.bool_), np.zeros(0, np.float32)
    end, found, error = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        px,
        np.ascontiguousarray(start, dtype=np.float32).copy(),
        winSize=(parameters.window_px | 1, parameters.window_px | 1),
        maxLevel=levels,
        criteria=cast(Any, _CRITERIA),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        | (cv2.OPTFLOW_LK_GET_MIN_EIGENVALS if want_texture else 0),
        minEigThreshold=parameters.min_texture**2 / _EIGENVALUE_UNIT,
    )
    error = np.asarray(error, dtype=np.float32)[:, 0]
    return (
        np.asarray(end, dtype=np.float32),
        np.asarray(found, dtype=np.uint8)[:, 0] > 0,
        np.sqrt(np.maximum(error, 0) * np.float32(_EIGENVALUE_UNIT)) if want_texture else error,
    )
