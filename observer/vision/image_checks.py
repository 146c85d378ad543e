"""Checks of a stereo pair: exposure, frozen images, row alignment, swapped sides.

Every check takes arrays and returns one sentence, or None if nothing is wrong. The thresholds were
set on all built-in scenarios with several seeds and on three KITTI drives; the comments give the
values observed there and the margins.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.robust import MAD_TO_SIGMA, median, tukey_weights
from observer.types import Image
from observer.vision.stereo import FIXED_POINT
from observer.vision.swapped import swapped_sentence

# Brightness is tested on about this many samples on a grid, whatever the image size; each is the
# mean of some neighbours, which halves the noise.
_SAMPLES = 2048
_NEIGHBOURS = 4
# Grey levels: the brightest 5 % of a usable image are far above this, of a black one with noise
# below.
_BLACK = 20.0
_WHITE = 250.0
# Grey levels between the darkest and the brightest 5 %: 60 and more in every scene. Noise of 3 grey
# levels alone gives 5.
_UNIFORM = 8.0
# The median of the three quartiles' ratios was 0.91 to 1.06 everywhere, although an object near
# one of the cameras changes a single quartile by a fifth.
_GAIN_RATIO = 1.25
# Side of the patch around a matched point over which its brightness is averaged.
_PATCH_PX = 5
# The mean step between pixels of one image was 0.89 to 1.12 of the other's everywhere. Noise also
# makes steps, so a covered lens keeps some.
_DETAIL_RATIO = 0.55
_DETAIL_STEP_PX = 3
_DETAIL_ROWS = 4


def exposure_reason(
    left: Image, right: Image, matched: tuple[Float64Array, Float64Array] | None = None
) -> str | None:
    """Check whether a rectified pair is black, white, covered, blurred or unequally bright.

    Takes 0.05 to 0.1 ms, whatever the size.

    Args:
        left, right: (H, W) grey.
        matched: pixels (N, 2) of the same points in each, if most of the image is matched: they
            decide whether the cameras themselves differ in brightness.
    """
    views = {"left": _quantiles(left), "right": _quantiles(right)}
    dead = {name: what for name, view in views.items() if (what := _emptiness(view)) is not None}
    if len(dead) == 2 and len(set(dead.values())) == 1:
        return f"both images are {dead['left']}: no light, covered lenses or a blank wall"
    if dead:
        faults = " and ".join(f"the {name} image is {what}" for name, what in dead.items())
        return f"{faults}: covered lens, wrong exposure or dead camera"
    detail = _detail(left) / max(_detail(right), 1e-9)
    if not _DETAIL_RATIO <= detail <= 1 / _DETAIL_RATIO:
        worse, better = ("left", "right") if detail < 1 else ("right", "left")
        share = 100 * min(detail, 1 / detail)
        return (
            f"the {worse} image has only {share:.0f} % of the detail of the {better} one: its lens "
            "is covered, dirty or out of focus"
        )
    ratio = median(views["right"][1:4] / np.maximum(views["left"][1:4], 1.0))
    unequal = not 1 / _GAIN_RATIO <= ratio <= _GAIN_RATIO
    if unequal and (matched is None or not equally_bright(left, right, *matched)):
        brighter, darker = ("right", "left") if ratio > 1 else ("left", "right")
        return (
            f"the {brighter} image is {max(ratio, 1 / ratio):.1f} times as bright as the {darker} "
            f"one: give both cameras the same exposure and gain"
        )
    return None


def equally_bright(left: Image, right: Image, px: Float64Array, right_px: Float64Array) -> bool:
    """Return whether the same points are equally bright in both images of a pair.

    A person close to the cameras fills more of one image than of the other, so the images differ
    in brightness although the cameras do not.

    Args:
        left, right: (H, W) grey, rectified. px, right_px: (N, 2) pixels of the points, N > 0.
    """
    before, after = _levels(left, px), _levels(right, right_px)
    ratio = median(after / np.maximum(before, 1.0))
    return 1 / _GAIN_RATIO <= ratio <= _GAIN_RATIO


def _levels(image: Image, px: Float64Array) -> Float64Array:
    """(N,) mean grey levels around pixels (N, 2)."""
    smooth = cv2.blur(image, (_PATCH_PX, _PATCH_PX))
    u, v = (np.ascontiguousarray(px[None, :, k], np.float32) for k in range(2))
    sampled = cv2.remap(smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled[0], np.float64)


def frozen_reason(
    previous_left: Image, previous_right: Image, left: Image, right: Image
) -> str | None:
    """Check whether a camera delivered the same image twice in a row.

    No sensor does: its noise alone changes pixels. Images without noise (rendered ones, or a video
    that repeats frames) may be equal while nothing moves; then no motion is missed. Takes 0.01 ms.

    Args:
        previous_left, previous_right, left, right: (H, W) or (H, W, 3), as delivered or rectified.
    """
    frozen = [
        name
        for name, before, now in (
            ("left", previous_left, left),
            ("right", previous_right, right),
        )
        if _is_same(before, now)
    ]
    if not frozen:
        return None
    which = "both images are" if len(frozen) == 2 else f"the {frozen[0]} image is"
    return f"{which} identical to the previous frame: frozen camera"


@dataclass(frozen=True)
class VerticalError:
    """Vertical disparity of a rectified pair: v_left - v_right of the same points.

    Attributes:
        median_px: the median, signed. centre_px: the fitted plane at the principal point.
        p95_px: 95 % of the points that fit the plane lie within this distance of 0.
        typical_px: root mean square of the fitted plane over the image. typical_std_px: its
            standard deviation.
        roll_rad: rotation of the right image relative to the left one, clockwise positive.
        stretch: by how much the right image is taller than the left one; 0.01 is one per cent.
        count: number of points that fit.
    """

    median_px: float
    centre_px: float
    p95_px: float
    typical_px: float
    typical_std_px: float
    roll_rad: float
    stretch: float
    count: int


# Fewer points determine a slope too poorly.
_MIN_ROW_POINTS = 20
_FIT_ROUNDS = 4
# Lucas-Kanade finds rows to 0.05 px at best; keeps perfect data from becoming outliers.
_MIN_SIGMA_PX = 0.05
_SURE_SIGMAS = 3.0


def vertical_error(
    px_left: NDArray[np.floating], vertical_disparity: NDArray[np.floating], camera: StereoCamera
) -> VerticalError | None:
    """Fit a plane to the vertical disparities with Tukey's weights; None with too few points.

    A wrong pitch between the cameras shifts all rows, a wrong roll tilts them along u, a wrong
    focal length along v (Hartley and Zisserman, Multiple View Geometry, 11.12). Takes 0.3 ms.

    Args:
        px_left: (N, 2) pixels in the left image.
        vertical_disparity: (N,) v_left - v_right in pixels; values that are not finite are left
            out.
    """
    vertical = np.asarray(vertical_disparity, dtype=np.float64)
    known = np.isfinite(vertical)
    if np.count_nonzero(known) < _MIN_ROW_POINTS:
        return None
    y = vertical[known]
    px = np.asarray(px_left, dtype=np.float64)[known]
    # In half image sizes, so that all three parameters are pixels of comparable effect.
    half = np.array([camera.width / 2, camera.height / 2])
    A = np.column_stack([np.ones(len(y)), (px - (camera.cx, camera.cy)) / half])
    plane = np.array([median(y), 0.0, 0.0])
    weight = np.ones(len(y))
    sigma = _MIN_SIGMA_PX
    for _ in range(_FIT_ROUNDS):
        residual = y - A @ plane
        sigma = max(_MIN_SIGMA_PX, MAD_TO_SIGMA * median(np.abs(residual)))
        weight = tukey_weights(residual, sigma)
        # A tiny prior of 1e-6 keeps collinear points from producing an arbitrary slope.
        information = (A * weight[:, None]).T @ A + np.diag([0.0, 1e-6, 1e-6]) * len(y)
        plane = np.linalg.solve(information, A.T @ (weight * y))
    fitting = weight > 0
    if np.count_nonzero(fitting) < _MIN_ROW_POINTS:
        return None
    sizes = np.sort(np.abs(y[fitting]))
    # Mean square of the plane over the image: a half-range of h contributes h^2 / 3.
    share = np.array([1.0, 1 / 3, 1 / 3])
    typical = float(np.sqrt(share @ plane**2))
    covariance = sigma**2 * np.linalg.inv(information)
    gradient = share * plane / max(typical, 1e-9)
    return VerticalError(
        median_px=median(y[fitting]),
        centre_px=float(plane[0]),
        p95_px=float(sizes[int(0.95 * (len(sizes) - 1))]),
        typical_px=typical,
        typical_std_px=float(np.sqrt(gradient @ covariance @ gradient)),
        roll_rad=float(-plane[1] / half[0]),
        stretch=float(-plane[2] / half[1]),
        count=int(np.count_nonzero(fitting)),
    )


def rectification_reason(error: VerticalError | None, warn_px: float = 1.0) -> str | None:
    """Check whether the rows of a rectified pair are too far apart for matching along rows.

    Block matching loses its support within one to two pixels, hence ``warn_px``. An error that
    exceeds it by less than three standard deviations is not reported.
    """
    if error is None or error.typical_px - _SURE_SIGMAS * error.typical_std_px <= warn_px:
        return None
    return (
        f"the epipolar error is {error.typical_px:.1f} px (median {error.median_px:+.1f} px, 95 % "
        f"within {error.p95_px:.1f} px, rotation {np.degrees(error.roll_rad):+.2f} deg; the limit "
        f"is {warn_px:g} px): recalibrate"
    )


# Both orders take 2 ms at this size; a larger image is reduced to it.
_SWAP_PIXELS = 32768
_SWAP_LEAST_SHRINK = 2.0
_SWAP_BLOCK_PX = 15
_SWAP_UNIQUENESS_PERCENT = 15
_SWAP_TEXTURE = 200
# In the right order 31 to 68 % of the pixels find a partner, in the wrong one 0 to 19 %, and at
# least 3.1 times as many in the right order in every single pair.
_SWAP_MIN_SUPPORT = 0.15
_SWAP_RATIO = 2.0
# Row shifts tried, in rows of the reduced images, each two pixels or more. With correct rows, a
# shift by one row finds at most 0.92 times as many partners; by 4 px, 0.7.
_MOST_ROWS, _ROWS_RATIO = 8, 1.15


def mismatch_reason(left: Image, right: Image, max_disparity_px: int) -> str | None:
    """Check why so little of a pair matches: left and right swapped, or rows far apart.

    Runs block matching on the pair as it is, in the other order, and with the right image shifted
    by whole rows. In the wrong order there are no true matches at positive disparities;
    disparities below one pixel, where the order makes no difference, do not count. Takes 2 ms at
    512x256 for each of at most 18 matchings, so call it only now and then while stereo finds
    little.

    Args:
        left, right: (H, W) grey, rectified. max_disparity_px: as of the stereo stage.
    """
    shrink = max(_SWAP_LEAST_SHRINK, (left.size / _SWAP_PIXELS) ** 0.5)
    size = (max(1, round(left.shape[1] / shrink)), max(1, round(left.shape[0] / shrink)))
    # At most a quarter of the width, so that half of it can be tested in both orders.
    count = min(-(-int(max_disparity_px / shrink) // 16), size[0] // 64) * 16
    if count == 0 or size[1] <= _SWAP_BLOCK_PX + 2 * _MOST_ROWS:
        return None
    small_left, small_right = (
        np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        for image in (left, right)
    )
    as_given = _support(small_left, small_right, count)
    swapped = _support(small_right, small_left, count)
    if swapped >= max(_SWAP_MIN_SUPPORT, _SWAP_RATIO * as_given):
        return swapped_sentence(swapped, as_given)
    shifts = [rows for rows in range(-_MOST_ROWS, _MOST_ROWS + 1) if rows]
    shifted = [_support(*_shifted(small_left, small_right, rows), count) for rows in shifts]
    best = int(np.argmax(shifted))
    if shifted[best] >= max(_SWAP_MIN_SUPPORT, _ROWS_RATIO * as_given):
        return (
            f"the epipolar error is about {abs(shifts[best]) * shrink:.0f} px: "
            f"{100 * shifted[best]:.0f} % of the image has a stereo match there and "
            f"{100 * as_given:.0f} % in its own row; recalibrate"
        )
    return None


def _shifted(left: Image, right: Image, rows: int) -> tuple[Image, Image]:
    """Return the parts of both images in which row v of one is row v + rows of the other."""
    height = left.shape[0]
    return (
        np.ascontiguousarray(left[max(0, -rows) : height - max(0, rows)]),
        np.ascontiguousarray(right[max(0, rows) : height - max(0, -rows)]),
    )


def _support(left: Image, right: Image, count: int) -> float:
    matcher = cv2.StereoBM.create(count, _SWAP_BLOCK_PX)
    matcher.setUniquenessRatio(_SWAP_UNIQUENESS_PERCENT)
    matcher.setTextureThreshold(_SWAP_TEXTURE)
    matcher.setDisp12MaxDiff(1)
    fixed = np.asarray(matcher.compute(left, right))[:, count : left.shape[1] - count]
    return float(np.count_nonzero(fixed >= FIXED_POINT) / fixed.size)


def _quantiles(image: Image) -> Float64Array:
    """(5,) the 5, 25, 50, 75 and 95 % quantiles of the grey levels."""
    step = max(1, int((image.size / _SAMPLES) ** 0.5))
    whole = image[step // 2 :: step, : image.shape[1] // step * step]
    neighbours = min(_NEIGHBOURS, step)
    samples = whole[:, ::step].astype(np.uint16)
    for offset in range(1, neighbours):
        samples += whole[:, offset::step]
    ordered = np.sort(samples, axis=None)
    at = (np.array([0.05, 0.25, 0.5, 0.75, 0.95]) * (len(ordered) - 1)).astype(np.intp)
    return ordered[at] / neighbours


def _emptiness(quantiles: Float64Array) -> str | None:
    darkest, _, middle, _, brightest = quantiles.tolist()
    if brightest < _BLACK:
        return "black"
    if middle > _WHITE:
        return "overexposed"
    if brightest - darkest < _UNIFORM:
        return "without any contrast"
    return None


def _detail(image: Image) -> float:
    """Mean difference of pixels a few columns apart, grey levels."""
    rows = image[::_DETAIL_ROWS]
    a, b = rows[:, _DETAIL_STEP_PX:], rows[:, :-_DETAIL_STEP_PX]
    return float(cv2.norm(a, b, cv2.NORM_L1)) / max(1, a.size)


def _is_same(a: Image, b: Image) -> bool:
    # Fast path: most images already differ in their first rows.
    return a.shape == b.shape and np.array_equal(a[:2], b[:2]) and np.array_equal(a, b)
