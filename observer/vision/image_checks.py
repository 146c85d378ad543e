"""Checks of the images of a stereo pair: exposure, detail, brightness, frozen cameras.

Every check takes arrays and returns one sentence, or None if nothing is wrong. The thresholds were
set on all built-in scenarios with several seeds and on three KITTI drives; the comments give the
values observed there and the margins.
"""

from __future__ import annotations

import cv2
import numpy as np

from observer.geometry import Float64Array
from observer.robust import median
from observer.types import Image

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
