"""Pyramidal Lucas-Kanade tracking of points, from frame to frame and from left to right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.track_checks import around_the_circle, on_the_row, with_returned
from observer.parameters import FlowParameters, KltTrackingParameters
from observer.types import Image

# Pixels: noise of a tracked point and of its disparity where it has not been estimated.
TYPICAL_SIGMA_PX = 0.15
# OpenCV returns the smaller eigenvalue of the mean gradient matrix in 1024 (grey levels/px)^2.
EIGENVALUE_UNIT = 1024.0
# Lucas-Kanade ends when a step is below this, px, or after this many steps: few when starting from
# a prediction, OpenCV's default when starting from the old position.
_CONVERGED_PX = 0.01
_STEPS_FROM_EXPECTED, _STEPS = 15, 30
# The first attempt, the checks, and the match in the other camera of points with known depth all
# start at the predicted place: a pyramid would only find wrong matches elsewhere. Points that the
# first attempt does not find are searched for over all levels.
_NEAR_LEVELS = 0
# Pyramid levels while the camera's motion is unknown, and once it is known.
FIRST_LEVELS, LEVELS = 4, 2
# The disparity of a new point is known to about a pixel, that of a blurred one to a few.
_COARSE_LEVELS = 1
# A mean absolute difference m of normally distributed noise means a deviation of m sqrt(pi / 2).
_DEVIATION = np.float32(np.sqrt(np.pi / 2))
# Texture below this, grey levels/px, cannot be distinguished from none.
_LEAST_TEXTURE = np.float32(1e-3)


@dataclass(frozen=True, eq=False)
class Sightings:
    """Positions of N tracked points in a new pair.

    Attributes:
        px: (N, 2) float32 pixels, left image. right_px: (N, 2) float32, right image; NaN where
            the point has no match there.
        found: (N,) whether the point was tracked in the left image and passed its checks.
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
    """Track points by Lucas-Kanade, with forward-backward check and circular matching.

    A point is found if tracking it back returns to within ``back_check_px`` of its start and its
    surroundings have texture in every direction. Its match in the right image counts if the two
    paths there, left(t) - left(t+dt) - right(t+dt) and left(t) - right(t) - right(t+dt), meet
    within ``circle_px`` (Geiger, Ziegler, Stiller: StereoScan, IV 2011).

    Args:
        previous, current: left and right image (H, W) grey, rectified.
        px, right_px: (N, 2) at t; NaN in ``right_px`` where there is no match; then there is no
            circular check and the match at t+dt counts alone.
        expected_px, expected_disparity: (N, 2), (N,) predictions for t+dt; points with NaN
            disparity are not matched in the right image.
        levels: pyramid levels beyond the full image: how far off the prediction may be.
    """
    p = parameters
    end, found, difference, texture = _track_back_and_forth(
        previous[0], current[0], px, expected_px, levels, p
    )
    seen = np.flatnonzero(found & np.isfinite(expected_disparity))
    matched, mismatch = match_right(
        current, end.take(seen, axis=0), expected_disparity.take(seen), p, _NEAR_LEVELS
    )
    before = right_px.take(seen, axis=0)
    # For these there are two paths to the right image, which must meet.
    circle = np.flatnonzero(np.isfinite(before[:, 0]) & np.isfinite(matched[:, 0]))
    around = _flow(
        previous[1],
        current[1],
        before.take(circle, axis=0),
        matched.take(circle, axis=0),
        _NEAR_LEVELS,
        p,
    )
    right, sigma = around_the_circle(
        difference,
        texture,
        seen,
        matched,
        mismatch,
        circle,
        around.px,
        around.status,
        np.float32(p.circle_px**2),
        np.float32(p.window_px | 1),
        _LEAST_TEXTURE,
        _DEVIATION,
        np.float32(p.noise_factor),
        np.float32(p.noise_floor_px),
    )
    return Sightings(end, right, found, sigma)


def _track_back_and_forth(
    previous: Image,
    current: Image,
    px: NDArray[np.float32],
    expected_px: NDArray[np.float32],
    levels: int,
    parameters: KltTrackingParameters,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32], NDArray[np.float32]]:
    """Return where points (N, 2) px are in the newer image, and which were tracked there.

    Also the mean absolute difference of their windows, grey levels, and their texture: (N,) each.
    """
    p = parameters
    height, width = current.shape
    end, found = np.ascontiguousarray(expected_px, np.float32), np.zeros(len(px), np.bool_)
    difference = texture = np.zeros(len(px), np.float32)
    for depth in dict.fromkeys((min(_NEAR_LEVELS, levels), levels)):
        # Points predicted outside the image are not searched for.
        open_ = np.flatnonzero(~found & _inside(expected_px, current))
        if len(open_) == 0:
            break
        start = px.take(open_, axis=0)
        there = _flow(previous, current, start, expected_px.take(open_, axis=0), depth, p)
        back = _flow(current, previous, there.px, start, _NEAR_LEVELS, p, want_texture=True)
        end, found, difference, texture = with_returned(
            end,
            found,
            difference,
            texture,
            open_,
            start,
            *there,
            *back,
            height,
            width,
            np.float32(p.window_px / 4),
            np.float32(EIGENVALUE_UNIT),
            np.float32(p.back_check_px**2),
            np.float32(p.max_error),
        )
    return end, found, difference, texture


def track_points(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    parameters: FlowParameters,
    *,
    back_check: bool,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Track points from one image to another, starting at their old positions.

    A point is rejected if it is lost, leaves the image, has less than ``min_texture`` in any
    direction (along a straight edge it would slide) or its surroundings differ by more than
    ``max_error``; with ``back_check`` also if tracking it back does not return to within
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
    end, status, error = _flow(first, second, px, None, p.pyramid_levels, p)
    good = (status > 0) & (error <= p.max_error) & _inside(end, first)
    if back_check:
        back, status, _ = _flow(second, first, end, None, p.pyramid_levels, p)
        good &= (status > 0) & (np.linalg.norm(back - px, axis=1) <= p.back_check_px)
    return end, good


def match_right(
    pair: tuple[Image, Image],
    px: NDArray[np.float32],
    expected_disparity: NDArray[np.float32],
    parameters: KltTrackingParameters,
    levels: int = _COARSE_LEVELS,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Match points (N, 2) of the left image in the right one, (N, 2) float32 pixels.

    NaN where the disparity is not known beforehand to within a few pixels, where Lucas-Kanade loses
    the point, and where the match is off the row by more than ``row_px``. Also returns (N,) grey
    levels, the mean difference of the surroundings.

    Args:
        pair: left and right image (H, W) grey, rectified.
        expected_disparity: (N,) pixels, NaN unknown.
        levels: pyramid levels beyond the full image: how far off the prediction may be.
    """
    height, width = pair[1].shape
    px = np.ascontiguousarray(px, np.float32)
    expected_disparity = np.ascontiguousarray(expected_disparity, np.float32)
    start = px.copy()
    start[:, 0] -= np.where(np.isfinite(expected_disparity), expected_disparity, 0.0)
    return on_the_row(
        px,
        expected_disparity,
        *_flow(pair[0], pair[1], px, start, levels, parameters),
        height,
        width,
        np.float32(parameters.row_px),
        np.float32(parameters.max_error),
    )


def as_bright_as(first: Image, second: Image, *, ignore_black: bool = False) -> Image:
    """Return the second image (H, W), scaled to the brightness of the first.

    Lucas-Kanade compares grey levels, so a flickering light looks like motion to it.

    Args:
        ignore_black: compare only where the second image is not 0, as outside a warped image.
    """
    seen = np.not_equal(second, 0).view(np.uint8) if ignore_black else None
    before, after = cv2.mean(first, seen)[0], cv2.mean(second, seen)[0]
    # Below one grey level, rounding would make the scaled image worse.
    if min(before, after) < 1 or abs(after - before) < 1:
        return second
    return np.asarray(cv2.convertScaleAbs(second, alpha=before / after), dtype=np.uint8)


class _Flow(NamedTuple):
    """Result of Lucas-Kanade for N points.

    Attributes:
        px: (N, 2) float32 pixels in the second image. status: (N,) not 0 where it found them.
        quality: (N,) mean absolute difference, grey levels, or the smaller eigenvalue of the
            gradient matrix, in OpenCV's unit; uninitialized for lost points.
    """

    px: NDArray[np.float32]
    status: NDArray[np.uint8]
    quality: NDArray[np.float32]


def _inside(px: NDArray[np.float32], image: Image) -> NDArray[np.bool_]:
    """(N,) which points (N, 2) px lie in the image."""
    height, width = image.shape
    u, v = px[:, 0], px[:, 1]
    return np.asarray((u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1), np.bool_)


def _flow(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    start: NDArray[np.float32] | None,
    levels: int,
    parameters: KltTrackingParameters | FlowParameters,
    *,
    want_texture: bool = False,
) -> _Flow:
    """Track points by Lucas-Kanade, with the quality of the match or of the texture.

    Args:
        px, start: (N, 2) in the first image, and initial guess in the second; None: as ``px``.
    """
    if len(px) == 0:
        return _Flow(px.copy(), np.zeros(0, np.uint8), np.zeros(0, np.float32))
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
        minEigThreshold=parameters.min_texture**2 / EIGENVALUE_UNIT,
    )
    return _Flow(
        np.asarray(end, np.float32),
        np.asarray(status, np.uint8)[:, 0],
        np.asarray(error, np.float32)[:, 0],
    )
