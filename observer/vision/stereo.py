"""Step 7 of the method: disparity, depth and point clouds of a rectified pair."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.parameters import StereoParameters
from observer.types import Image

# OpenCV's matchers return sixteenths of a pixel; everything below 0 means "unknown".
FIXED_POINT = 16
_SPECKLE_PIXELS = 60
_SPECKLE_RANGE_PX = 2
_LEFT_RIGHT_TOLERANCE_PX = 1
# Neighbouring pixels that differ by more than this belong to different surfaces.
_EDGE_PX = 1.0
# Margin around the requested points, so that they are matched with their surroundings.
_MARGIN_PX = 32


def disparity_map(left: Image, right: Image, parameters: StereoParameters) -> NDArray[np.float32]:
    """Return the dense disparity of a rectified pair.

    ``bm`` is block matching. ``sgbm`` is semi-global matching (Hirschmueller, 2008) along the
    three directions of OpenCV's ``MODE_SGBM_3WAY``, which is twice as fast on two cores as five
    directions and whose result does not depend on the number of threads.

    Args:
        left, right: (H, W) grey.

    Returns:
        (H, W) pixels, NaN where unknown.
    """
    count = _disparities(parameters)
    block = parameters.block_px | 1
    height, width = left.shape
    # The matchers skip the first ``count`` columns, although the right camera may see points there
    # too; a margin on the left recovers these columns.
    wide_left = cv2.copyMakeBorder(left, 0, 0, count, 0, cv2.BORDER_REPLICATE)
    wide_right = cv2.copyMakeBorder(right, 0, 0, count, 0, cv2.BORDER_REPLICATE)
    matcher: cv2.StereoMatcher
    if parameters.matcher == "bm":
        matcher = cv2.StereoBM.create(count, max(5, min(block, height, width) | 1))
        matcher.setUniquenessRatio(parameters.uniqueness_percent)
        matcher.setDisp12MaxDiff(_LEFT_RIGHT_TOLERANCE_PX)
        matcher.setSpeckleWindowSize(_SPECKLE_PIXELS)
        matcher.setSpeckleRange(_SPECKLE_RANGE_PX * FIXED_POINT)
    else:
        matcher = cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=count,
            blockSize=block,
            P1=8 * block * block,
            P2=32 * block * block,
            disp12MaxDiff=_LEFT_RIGHT_TOLERANCE_PX,
            preFilterCap=31,
            uniquenessRatio=parameters.uniqueness_percent,
            speckleWindowSize=_SPECKLE_PIXELS,
            speckleRange=_SPECKLE_RANGE_PX,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )
    fixed = np.asarray(matcher.compute(wide_left, wide_right))[:, count:]
    disparity = fixed.astype(np.float32) / np.float32(FIXED_POINT)
    # Drop matches beyond the right image's left edge, which lie in the margin.
    columns = np.arange(width, dtype=np.float32)
    known = (fixed > 0) & (disparity <= columns)
    return np.where(known, disparity, np.float32(np.nan))


def disparity_around(
    left: Image, right: Image, px: NDArray[np.float32], parameters: StereoParameters
) -> NDArray[np.float32]:
    """Return the disparity as ``disparity_map``, but only in the rectangle around some points.

    Matching is the most expensive step of all, and the transformed pair is needed only where
    something moves.

    Args:
        left, right: (H, W) grey.
        px: (N, 2) pixels in the left image.

    Returns:
        (H, W) pixels, NaN where unknown or not computed.
    """
    height, width = left.shape
    disparity = np.full((height, width), np.nan, np.float32)
    if len(px) == 0:
        return disparity
    u0, v0 = np.maximum(np.floor(px.min(axis=0)).astype(int) - _MARGIN_PX, 0)
    u1, v1 = np.minimum(np.ceil(px.max(axis=0)).astype(int) + _MARGIN_PX, (width, height))
    # The right camera sees a point further to the left by its disparity.
    begin = max(0, u0 - _disparities(parameters))
    part = disparity_map(left[v0:v1, begin:u1], right[v0:v1, begin:u1], parameters)
    disparity[v0:v1, u0:u1] = part[:, u0 - begin :]
    return disparity


def sample_disparity(disparity: NDArray[np.float32], px: NDArray[np.float32]) -> Float64Array:
    """Return the disparity (N,) at subpixel positions (N, 2), NaN where unknown.

    It is interpolated bilinearly. Between two surfaces the mean is meaningless, so positions whose
    known neighbours differ by more than a pixel are unknown, as are those with less than half of
    the weight known.
    """
    height, width = disparity.shape
    position = np.asarray(px, dtype=np.float64).reshape(-1, 2)
    limits = (width - 1, height - 1)
    inside = np.asarray(((position >= 0) & (position <= limits)).all(axis=1), np.bool_)
    safe = np.where(inside[:, None], position, 0.0)
    u0 = np.minimum(safe[:, 0].astype(np.intp), width - 2)
    v0 = np.minimum(safe[:, 1].astype(np.intp), height - 2)
    a, b = safe[:, 0] - u0, safe[:, 1] - v0
    values = np.stack(
        [disparity[v0 + dv, u0 + du] for dv in (0, 1) for du in (0, 1)], axis=1
    ).astype(np.float64)
    weights = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=1)
    known = np.isfinite(values)
    weights = np.where(known, weights, 0.0)
    total = weights.sum(axis=1)
    highest = np.where(known, values, -np.inf).max(axis=1)
    lowest = np.where(known, values, np.inf).min(axis=1)
    good = inside & (total >= 0.5) & (highest - lowest <= _EDGE_PX)
    mean = (weights * np.where(known, values, 0.0)).sum(axis=1) / np.where(good, total, 1.0)
    return np.where(good, mean, np.nan)


def point_cloud(
    disparity: NDArray[np.float32],
    image: Image,
    camera: StereoCamera,
    parameters: StereoParameters,
    max_points: int,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return the dense cloud for display: at most ``max_points``, on a regular pixel grid.

    Args:
        disparity: (H, W) pixels, NaN = unknown.
        image: (H, W) grey or (H, W, 3) BGR rectified left image of the same instant.

    Returns:
        points (N, 3) float32, metres, camera frame; colours (N, 3) uint8, RGB.
    """
    depth_limits = (parameters.min_depth_m, parameters.max_depth_m)
    nearest, farthest = (camera.fb / z for z in depth_limits)
    with np.errstate(invalid="ignore"):
        known = np.asarray((disparity >= farthest) & (disparity <= nearest), dtype=np.bool_)
    count = int(np.count_nonzero(known))
    step = max(1, int(np.ceil(np.sqrt(count / max(1, max_points)))))
    v, u = np.nonzero(known[::step, ::step])
    v, u = v[:max_points] * step, u[:max_points] * step
    z = camera.fb / disparity[v, u]
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=1)
    grey_or_bgr = image[v, u]
    colors = grey_or_bgr[:, ::-1] if image.ndim == 3 else np.repeat(grey_or_bgr[:, None], 3, axis=1)
    return points.astype(np.float32), np.ascontiguousarray(colors)


def _disparities(parameters: StereoParameters) -> int:
    """Return the number of disparities to search: OpenCV requires a multiple of 16."""
    return -(-parameters.max_disparity_px // 16) * 16
