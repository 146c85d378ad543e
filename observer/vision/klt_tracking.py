"""Pyramidal Lucas-Kanade tracking of points, from frame to frame and from left to right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import FlowParameters, KltTrackingParameters
from observer.types import Image

# OpenCV gives the smaller eigenvalue of the mean gradient matrix in 1/1024 (grey levels/px)^2.
_EIGENVALUE_UNIT = 1024.0
# Lucas-Kanade ends when it moves less than this, px, or after so many steps: few from where a
# point is expected, OpenCV's own number from where it was.
_CONVERGED_PX = 0.01
_STEPS_FROM_EXPECTED, _STEPS = 15, 30
# The first attempt, the checks, and the other camera's view of points whose depth is known, start
# where the answer should be: a pyramid would only find what is somewhere else. What the first
# attempt does not find is searched for over all levels.
_NEAR_LEVELS = 0
# Pyramid levels while nothing is known of the camera's motion, and once it is.
FIRST_LEVELS, LEVELS = 4, 2
# The disparity of a new point is known to about a pixel, and of a blurred one to a few.
_COARSE_LEVELS = 1
# A mean absolute difference m of normally distributed noise means a deviation of m sqrt(pi / 2).
_DEVIATION = float(np.sqrt(np.pi / 2))
# Texture below this, grey levels/px, cannot be told from none.
_LEAST_TEXTURE = 1e-3


@dataclass(frozen=True, eq=False)
class Sightings:
    """Positions of N tracked points in a new pair.

    Attributes:
        px: (N, 2) float32 pixels, left image. right_px: (N, 2) float32, right image; NaN where
            the point has no match there.
        found: (N,) whether the point was followed in the left image and passed its checks.
        sigma: (N, 2) float32 pixels, one standard deviation of ``px`` and of the match in the
            right image.
    """

    px: NDArray[np.float32]
    right_px: NDArray[np.float32]
    found: NDArray[np.bool_]
    sigma: NDArray[np.float32]


def track_stereo_points(
    previous: tuple[Image, Image],
    current: tuple[Image, Image],
    px: NDArray[np.float32],
    right_px: NDArray[np.float32],
    expected_px: NDArray[np.float32],
    expected_disparity: NDArray[np.float32],
    levels: int,
    parameters: KltTrackingParameters,
) -> Sightings:
    """Track points by Lucas-Kanade, back again, and around the circle of the four images.

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
    end, difference = np.array(expected_px, np.float32), np.zeros(count, np.float32)
    texture, found = np.zeros(count, np.float32), np.zeros(count, np.bool_)
    for depth in dict.fromkeys((min(_NEAR_LEVELS, levels), levels)):
        # What is expected outside the image is not searched for.
        open_ = np.flatnonzero(~found & _inside(expected_px, current[0], 0.0))
        if len(open_) == 0:
            break
        end[open_], found[open_], difference[open_], texture[open_] = _there_and_back(
            previous[0], current[0], px[open_], expected_px[open_], depth, parameters
        )
    matched = np.full((count, 2), np.nan, np.float32)
    mismatch = np.zeros(count, np.float32)
    seen = np.flatnonzero(found & np.isfinite(expected_disparity))
    matched[seen], mismatch[seen] = match_right(
        current, end[seen], expected_disparity[seen], parameters, _NEAR_LEVELS
    )
    circle = seen[np.isfinite(right_px[seen, 0]) & np.isfinite(matched[seen, 0])]
    around, status, _ = _flow(
        previous[1], current[1], right_px[circle], matched[circle], _NEAR_LEVELS, parameters
    )
    apart = ((around - matched[circle]) ** 2).sum(axis=1) > parameters.circle_px**2
    matched[circle[apart | ~status]] = np.nan
    noise = _noise_px(np.stack([difference, mismatch], axis=1), texture[:, None], parameters)
    return Sightings(end, matched, found, noise)


def track_points(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    parameters: FlowParameters,
    *,
    back_check: bool,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Track points from one image to another, each from where it was.

    A point is refused where it is lost, leaves the image, has less than ``min_texture`` in any
    direction (along a straight edge it would slide) or its surroundings differ by more than
    ``max_error``; with ``back_check`` also where tracking it back does not return to within
    ``back_check_px`` of the start.

    Args:
        first, second: (H, W) grey.
        px: (N, 2) pixels in the first image.

    Returns:
        (N, 2) pixels in the second image, and (N,) which of them are good.
    """
    p = parameters
    if p.match_brightness:
        second = as_bright_as(first, second, ignore_black=True)
    end, found, error = _flow(first, second, px, None, p.pyramid_levels, p)
    good = found & (error <= p.max_error) & _inside(end, first, 0.0)
    if back_check:
        back, found, _ = _flow(second, first, end, None, p.pyramid_levels, p)
        good &= found & (np.linalg.norm(back - px, axis=1) <= p.back_check_px)
    return end, good


def match_right(
    pair: tuple[Image, Image],
    px: NDArray[np.float32],
    expected_disparity: NDArray[np.float32],
    parameters: KltTrackingParameters,
    levels: int = _COARSE_LEVELS,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Match points (N, 2) of the left image in the right one, (N, 2) float32 pixels.

    NaN where it is not known beforehand to within a few pixels, where Lucas-Kanade loses it, and
    where the match lies off the row by more than ``row_px``. Also (N,) grey levels: by how much
    the surroundings of both differ on average.

    Args:
        pair: left and right image (H, W) grey, rectified.
        expected_disparity: (N,) pixels, NaN unknown.
        levels: of the pyramid, beyond the full image: how far off the expectation may be.
    """
    known = np.isfinite(expected_disparity)
    start = px.copy()
    start[:, 0] -= np.where(known, expected_disparity, 0.0)
    end, status, difference = _flow(pair[0], pair[1], px, start, levels, parameters)
    good = known & status & (difference <= parameters.max_error)
    good &= np.abs(end[:, 1] - px[:, 1]) <= parameters.row_px
    good &= _inside(end, pair[1], 0.0)
    return np.where(good[:, None], end, np.float32(np.nan)), difference


def as_bright_as(first: Image, second: Image, *, ignore_black: bool = False) -> Image:
    """Return the second image (H, W), scaled to the brightness of the first.

    Lucas-Kanade compares grey levels, so that a light that flickers looks like motion to it.

    Args:
        ignore_black: compare only where the second image is not 0, as outside a warped image.
    """
    seen = np.not_equal(second, 0).view(np.uint8) if ignore_black else None
    before, after = cv2.mean(first, seen)[0], cv2.mean(second, seen)[0]
    # Below a grey level the scaling would make the image worse by rounding.
    if min(before, after) < 1 or abs(after - before) < 1:
        return second
    return np.asarray(cv2.convertScaleAbs(second, alpha=before / after), dtype=np.uint8)


def _there_and_back(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    expected_px: NDArray[np.float32],
    levels: int,
    parameters: KltTrackingParameters,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32], NDArray[np.float32]]:
    """(N, 2) where points are, (N,) whether they return, (N,) difference, (N,) texture."""
    end, status, difference = _flow(first, second, px, expected_px, levels, parameters)
    back, returned, texture = _flow(
        second, first, end, px, _NEAR_LEVELS, parameters, want_texture=True
    )
    found = status & returned & _inside(end, second, parameters.window_px / 4)
    found &= ((back - px) ** 2).sum(axis=1) <= parameters.back_check_px**2
    found &= difference <= parameters.max_error
    return end, found, difference, texture


def _noise_px(
    difference: NDArray[np.float32],
    texture: NDArray[np.float32],
    parameters: KltTrackingParameters,
) -> NDArray[np.float32]:
    """Standard deviation, pixels, of a match by Lucas-Kanade.

    Least squares over a window of n pixels whose gradient is g along the weakest direction knows
    the shift to ``noise / (g sqrt(n))`` (the inverse of its normal matrix). What Lucas-Kanade
    cannot model comes on top.

    Args:
        difference: (N, K) grey levels, mean absolute difference of the two windows.
        texture: (N, 1) grey levels/px, root mean square of the gradient g.
    """
    side = parameters.window_px | 1
    statistical = _DEVIATION * difference / np.maximum(side * texture, _LEAST_TEXTURE)
    return np.hypot(parameters.noise_factor * statistical, parameters.noise_floor_px)


def _inside(px: NDArray[np.float32], image: Image, margin: float) -> NDArray[np.bool_]:
    """(N,) which points (N, 2) lie in the image, at least ``margin`` pixels from its edge."""
    height, width = image.shape
    limits = (width - 1 - margin, height - 1 - margin)
    return np.asarray(((px >= margin) & (px <= limits)).all(axis=1), dtype=np.bool_)


def _flow(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    start: NDArray[np.float32] | None,
    levels: int,
    parameters: KltTrackingParameters | FlowParameters,
    *,
    want_texture: bool = False,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
    """Track points by Lucas-Kanade, with the quality of the match or of the texture.

    Args:
        px, start: (N, 2) in the first image, and about where in the second; None: where they were.

    Returns:
        (N, 2) pixels; (N,); (N,) mean absolute difference, grey levels, or with ``want_texture``
        the texture, grey levels/px. Of points that were not found the latter is 0.
    """
    if len(px) == 0:
        return px.copy(), np.zeros(0, np.bool_), np.zeros(0, np.float32)
    steps = _STEPS if start is None else _STEPS_FROM_EXPECTED
    side = parameters.window_px | 1
    end, status, error = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        np.ascontiguousarray(px),
        cast(Any, None if start is None else np.array(start, np.float32)),
        winSize=(side, side),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, steps, _CONVERGED_PX),
        flags=(0 if start is None else cv2.OPTFLOW_USE_INITIAL_FLOW)
        | (cv2.OPTFLOW_LK_GET_MIN_EIGENVALS if want_texture else 0),
        minEigThreshold=parameters.min_texture**2 / _EIGENVALUE_UNIT,
    )
    found = np.asarray(status, dtype=np.uint8)[:, 0] > 0
    # OpenCV leaves the quality of lost points as it found the memory.
    quality = np.where(found, np.asarray(error, dtype=np.float32)[:, 0], np.float32(0))
    if want_texture:
        quality = np.sqrt(np.maximum(quality, 0) * np.float32(_EIGENVALUE_UNIT))
    return np.asarray(end, dtype=np.float32), found, np.asarray(quality, dtype=np.float32)
