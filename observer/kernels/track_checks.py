"""Checks of points tracked by Lucas-Kanade: forward-backward, same row, and circular."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    BYTES1,
    FLAGS1,
    SINGLE,
    SINGLES1,
    SINGLES2,
    WHOLE,
    WHOLES1,
    Bytes,
    Flags,
    Indices,
    Singles,
    kernel,
    part,
)

_NONE = np.float32(0.0)
_NAN = np.float32(np.nan)


@part
def _inside(px: Singles, i: int, height: int, width: int, margin: np.float32) -> bool:
    """Return whether point i of (N, 2) px is at least ``margin`` from the image's edges."""
    u, v = px[i, 0], px[i, 1]
    within = u >= margin and u <= width - 1 - margin
    return bool(within and v >= margin and v <= height - 1 - margin)


@part
def _apart2(a: Singles, i: int, b: Singles, j: int) -> np.float32:
    """Squared distance of point i of (N, 2) px and point j of (M, 2)."""
    across, down = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]
    return np.float32(across * across + down * down)


@kernel(
    SINGLES2, FLAGS1, SINGLES1, SINGLES1, WHOLES1, SINGLES2, SINGLES2, BYTES1, SINGLES1,
    SINGLES2, BYTES1, SINGLES1, WHOLE, WHOLE, SINGLE, SINGLE, SINGLE, SINGLE,
)  # fmt: skip
def with_returned(
    end: Singles,
    found: Flags,
    difference: Singles,
    texture: Singles,
    at: Indices,
    start: Singles,
    there: Singles,
    status: Bytes,
    error: Singles,
    back: Singles,
    back_status: Bytes,
    eigenvalue: Singles,
    height: int,
    width: int,
    margin: np.float32,
    unit: np.float32,
    back_square: np.float32,
    max_error: np.float32,
) -> tuple[Singles, Flags, Singles, Singles]:
    """Return the state of N points after some (M,) were tracked to an image and back.

    Args:
        end, found, difference, texture: (N, 2), (N,), (N,), (N,) state before, see below.
        at: (M,) indices of the tracked points. start: (M, 2) pixels, where they started.
        there, status, error: (M, 2), (M,), (M,) where they ended, whether they were found, and how
            much the images differ there. back, back_status, eigenvalue: the same of tracking back,
            with the smaller eigenvalue of the gradient matrix, in ``unit`` (grey levels/px)^2.
        height, width: of the images. margin: pixels from their edges within which points fail.
        back_square: px^2, squared distance by which a point may miss its start.
        max_error: grey levels.

    Returns:
        (N, 2) pixels where they are, (N,) which of them passed the checks, (N,) grey levels, by
        how much the images differ there, (N,) grey levels/px, root mean square of the gradient.
    """
    count = len(found)
    new_end, new_found = np.empty((count, 2), np.float32), np.empty(count, np.bool_)
    new_difference, new_texture = np.empty(count, np.float32), np.empty(count, np.float32)
    for i in range(count):
        new_end[i, 0], new_end[i, 1], new_found[i] = end[i, 0], end[i, 1], found[i]
        new_difference[i], new_texture[i] = difference[i], texture[i]
    for k in range(len(at)):
        i = at[k]
        new_end[i, 0], new_end[i, 1] = there[k, 0], there[k, 1]
        # For lost points OpenCV leaves the error uninitialized.
        new_difference[i] = error[k] if status[k] > 0 else _NONE
        square = max(eigenvalue[k], _NONE) if back_status[k] > 0 else _NONE
        new_texture[i] = np.float32(math.sqrt(square * unit))
        new_found[i] = (
            status[k] > 0
            and back_status[k] > 0
            and _inside(there, k, height, width, margin)
            and _apart2(back, k, start, k) <= back_square
            and error[k] <= max_error
        )
    return new_end, new_found, new_difference, new_texture


@kernel(
    SINGLES2, SINGLES1, SINGLES2, BYTES1, SINGLES1, WHOLE, WHOLE, SINGLE, SINGLE
)  # fmt: skip
def on_the_row(
    px: Singles,
    expected_disparity: Singles,
    end: Singles,
    status: Bytes,
    error: Singles,
    height: int,
    width: int,
    row_px: np.float32,
    max_error: np.float32,
) -> tuple[Singles, Singles]:
    """Check matches of N points (N, 2) px in the right image.

    Args:
        expected_disparity: (N,) pixels, NaN unknown.
        end, status, error: (N, 2), (N,), (N,) as of ``with_returned``.
        row_px: pixels by which a match may lie off the row.

    Returns:
        (N, 2) pixels in the right image, NaN where there is no match, and (N,) grey levels, by how
        much the images differ there.
    """
    count = len(px)
    matched, difference = np.empty((count, 2), np.float32), np.empty(count, np.float32)
    for i in range(count):
        difference[i] = error[i] if status[i] > 0 else _NONE
        good = (
            status[i] > 0
            and math.isfinite(expected_disparity[i])
            and error[i] <= max_error
            and abs(end[i, 1] - px[i, 1]) <= row_px
            and _inside(end, i, height, width, _NONE)
        )
        matched[i, 0], matched[i, 1] = (end[i, 0], end[i, 1]) if good else (_NAN, _NAN)
    return matched, difference


@part
def _noise(
    difference: np.float32,
    deviation: np.float32,
    slope: np.float32,
    factor: np.float32,
    floor: np.float32,
) -> np.float32:
    """Standard deviation, pixels, of a match by Lucas-Kanade.

    Least squares over a window of n pixels whose gradient is g along the weakest direction gives
    the shift to ``noise / (g sqrt(n))`` (the inverse of its normal matrix). Errors that
    Lucas-Kanade cannot model are added as ``floor``.

    Args:
        difference: grey levels, mean absolute difference of the two windows.
        slope: grey levels, g sqrt(n).
    """
    statistical = np.float64(factor * (deviation * difference / slope))
    return np.float32(math.sqrt(statistical * statistical + np.float64(floor) ** 2))


@kernel(
    SINGLES1, SINGLES1, WHOLES1, SINGLES2, SINGLES1, WHOLES1, SINGLES2, BYTES1,
    SINGLE, SINGLE, SINGLE, SINGLE, SINGLE, SINGLE,
)  # fmt: skip
def around_the_circle(
    difference: Singles,
    texture: Singles,
    at: Indices,
    matched: Singles,
    mismatch: Singles,
    circle: Indices,
    around: Singles,
    status: Bytes,
    circle_square: np.float32,
    side: np.float32,
    least_texture: np.float32,
    deviation: np.float32,
    factor: np.float32,
    floor: np.float32,
) -> tuple[Singles, Singles]:
    """Return the matches in the right image that both paths agree on, and the noise of all.

    Args:
        difference: (N,) grey levels, and texture: (N,) grey levels/px, in the left image.
        at: (M,) indices of the points that were matched, to matched: (M, 2) pixels, NaN unknown,
            with mismatch: (M,) grey levels.
        circle: (C,) which of the M were also tracked within the right image, to around: (C, 2)
            pixels, if their status (C,) is not 0.
        circle_square: px^2, squared distance by which the two paths may differ.
        side: of the window, pixels. least_texture: grey levels, least slope assumed.
        deviation: standard deviation of grey levels per mean absolute difference.
        factor: on the noise that follows from it. floor: pixels, additional noise.

    Returns:
        (N, 2) pixels in the right image, NaN unknown, and (N, 2) pixels, one standard deviation in
        the left image and of the match in the right one.
    """
    count = len(difference)
    right, sigma = np.empty((count, 2), np.float32), np.empty((count, 2), np.float32)
    for i in range(count):
        right[i, 0] = right[i, 1] = _NAN
        slope = max(side * texture[i], least_texture)
        sigma[i, 0] = _noise(difference[i], deviation, slope, factor, floor)
        sigma[i, 1] = floor
    for k in range(len(at)):
        i = at[k]
        right[i, 0], right[i, 1] = matched[k, 0], matched[k, 1]
        slope = max(side * texture[i], least_texture)
        sigma[i, 1] = _noise(mismatch[k], deviation, slope, factor, floor)
    for n in range(len(circle)):
        k = circle[n]
        if status[n] == 0 or _apart2(around, n, matched, k) > circle_square:
            right[at[k], 0] = right[at[k], 1] = _NAN
    return right, sigma
