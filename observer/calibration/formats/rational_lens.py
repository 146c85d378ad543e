"""Radius up to which a lens model is one-to-one, and replacement of rational models with a pole.

A rational model (k4 k5 k6) that was fitted with more freedom than its views determine has a root
of the numerator beside one of the denominator. Everywhere else the two cancel; between them the
image folds over. Outside the image this does no harm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array

# Roots in r^2 closer together than this share cancel, except right at the pole.
_CANCELLING = 0.02
# Beyond the image's corners, a lens is only evaluated for interpolation.
_MARGIN = 1.02
# Share of r^2 up to the fold to which the lens without the pole is fitted: closer to the fold, the
# pole distorts the data.
_UNDISTURBED = 0.75
# Largest rms difference from the given lens over that part that a substitute may have, px.
_LARGEST_RMS_PX = 0.5
# Samples of r, which is the tangent of the angle to the axis; 3 is 72 degrees.
_RADII = np.linspace(0.0, 3.0, 6001)


@dataclass(frozen=True, eq=False)
class Smooth:
    """A substitute for a lens whose pole lies within the image.

    Attributes:
        D: (N,) distortion with new k1 k2 k3 and without k4 k5 k6.
        fold_px: radius from the centre at which the given lens folds over, px.
        largest_px: largest difference between the two within ``within_px`` of the centre.
        within_px: the radius up to which the new one was fitted to the given one.
    """

    D: Float64Array
    fold_px: float
    largest_px: float
    within_px: float


def fold_px(K: Float64Array, D: Float64Array, size: tuple[int, int]) -> float | None:
    """Return the radius in pixels at which a lens folds over within its image, or None.

    Only the radial part counts; tilts and tangential terms hardly move a fold.

    Args:
        K: (3, 3) camera matrix, px. D: (N,) k1 k2 p1 p2 [k3 [k4 k5 k6 [...]]].
        size: width and height, px.
    """
    at = _fold(D)
    if at is None:
        return None
    reach = float(_RADII[at] * _factor(D, _RADII[at : at + 1] ** 2)[0])
    return reach * _focal(K) if reach < _MARGIN * _corner(K, size) else None


def without_pole(K: Float64Array, D: Float64Array, size: tuple[int, int]) -> Smooth | None:
    """Return a substitute for a lens whose numerator and denominator nearly cancel in the image.

    Args:
        K, D, size: as for ``fold_px``.

    Returns:
        A lens that follows the given one as far as the pole leaves it undisturbed and is
        one-to-one in the whole image; None where there is no such pole, or no such lens.
    """
    fold = fold_px(K, D, size)
    at = _fold(D)
    if fold is None or at is None or not _has_cancelling_pole(D, float(_RADII[at])):
        return None
    s = _RADII[1:at] ** 2
    s = s[s <= _UNDISTURBED * _RADII[at] ** 2]
    r = np.sqrt(s)
    powers = np.stack([s, s**2, s**3], axis=1)
    bent = _factor(D, s) - 1
    # Use fewer terms if more would fold over where they extrapolate.
    for terms in (3, 2, 1):
        # An error of the factor is weighted by the radius that it multiplies.
        k = np.zeros(3)
        k[:terms] = np.linalg.lstsq(powers[:, :terms] * r[:, None], bent * r, rcond=None)[0]
        rest = [0.0, 0.0, 0.0, *D[8:].tolist()] if D[8:].any() else []
        smooth = np.array([k[0], k[1], D[2], D[3], k[2], *rest])
        off = np.abs(_factor(smooth, s) - 1 - bent) * r * _focal(K)
        rms = float(np.sqrt(np.mean(off**2)))
        if rms <= _LARGEST_RMS_PX and fold_px(K, smooth, size) is None:
            within = float(r[-1] * (1 + bent[-1])) * _focal(K)
            return Smooth(smooth, fold, float(off.max()), within)
    return None


def _factor(D: Float64Array, s: Float64Array) -> Float64Array:
    """Factor by which the radius is stretched at s = r^2, (N,)."""
    k = np.zeros(8)
    k[: min(8, len(D))] = D[:8]
    with np.errstate(all="ignore"):
        above = 1 + s * (k[0] + s * (k[1] + s * k[4]))
        below = 1 + s * (k[5] + s * (k[6] + s * k[7]))
        return np.asarray(above / below, dtype=np.float64)


def _fold(D: Float64Array) -> int | None:
    """Return the index of the first radius from which the image's radius no longer grows."""
    with np.errstate(all="ignore"):
        grows = np.diff(_RADII * _factor(D, _RADII**2)) > 0
    return None if grows.all() else int(np.argmin(grows))


def _has_cancelling_pole(D: Float64Array, fold: float) -> bool:
    if len(D) < 8 or not np.isfinite(D).all():
        return False
    zeros = _roots([D[4], D[1], D[0], 1.0])
    poles = _roots([D[7], D[6], D[5], 1.0])
    # The fold lies just before the pole that makes it.
    poles = poles[poles > fold**2]
    if not len(poles) or not len(zeros):
        return False
    nearest = float(poles.min())
    return bool((np.abs(zeros - nearest) < _CANCELLING * nearest).any())


def _roots(coefficients: list[float]) -> Float64Array:
    """Return the real positive roots."""
    with np.errstate(all="ignore"):
        try:
            roots = np.roots(coefficients)
        except np.linalg.LinAlgError:
            return np.zeros(0)
    real = roots.real[np.abs(roots.imag) < 1e-9 * np.abs(roots)]
    return np.asarray(real[real > 0], dtype=np.float64)


def _focal(K: Float64Array) -> float:
    return float(np.sqrt(abs(K[0, 0] * K[1, 1])))


def _corner(K: Float64Array, size: tuple[int, int]) -> float:
    """Return the largest distance of a corner from the axis, as a tangent."""
    x = max(K[0, 2], size[0] - 1 - K[0, 2]) / K[0, 0]
    y = max(K[1, 2], size[1] - 1 - K[1, 2]) / K[1, 1]
    return float(np.hypot(x, y))
