"""The answer for a pixel, and the numbers and phrases shared by all methods' answers."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.parameters import Parameters

# Radius around a pixel, as a share of the image's width: about the distance of features on one
# textured surface, 10 px of 512.
_RADIUS_SHARE = 1 / 50
_LEAST_RADIUS_PX = 6.0
# Number of nearest features that decide for a pixel; odd, so that there is a majority.
_SPEAKERS = 5


class PixelVerdict(StrEnum):
    """Verdict on a pixel.

    ``undecided``: there are features, but they are too young, too few of them agree, their depth
    is unknown, or their motion is not significant enough.
    """

    DYNAMIC = "dynamic"
    STATIC = "static"
    UNDECIDED = "undecided"
    TOO_FAR = "too_far"
    TOO_FEW_FEATURES = "too_few_features"
    EGO_MOTION_LOST = "ego_motion_lost"
    OUTSIDE = "outside"


@dataclass(frozen=True)
class PixelAnswer:
    """Verdict on one pixel, with its reasons.

    Attributes:
        px: u, v in the rectified left image of t+dt.
        sentence: one sentence: what it counts as, and why.
        numbers: the figures behind it, finite, by a name that ends with the unit (``_px``,
            ``_m``, ``_mps``, ``_s``) if there is one; None = unknown; numbers that do not apply
            are absent. Counts of features and matches, and ``significance`` (standard
            deviations), have no unit.
        would_change: one sentence: which parameter, at which value, or what else would give
            another answer.
    """

    px: tuple[float, float]
    verdict: PixelVerdict
    sentence: str
    numbers: Mapping[str, float | None]
    would_change: str


@dataclass(frozen=True, eq=False)
class Nearby:
    """The features around a pixel, nearest first.

    Attributes:
        members: indices of those within the radius. nearest_px: distance of the nearest feature
            of all, pixels; None without any.
        radius_px: the radius used.
    """

    members: NDArray[np.intp]
    nearest_px: float | None
    radius_px: float

    @property
    def speakers(self) -> NDArray[np.intp]:
        """Nearest of them, an odd number, that decide for the pixel."""
        count = min(len(self.members), _SPEAKERS)
        return self.members[: count - 1 + count % 2]

    @property
    def nearest(self) -> str:
        """Distance of the nearest feature of all, in words."""
        if self.nearest_px is None:
            return "there is none in the image"
        return f"the nearest is {self.nearest_px:.0f} px away"

    @property
    def numbers(self) -> dict[str, float | None]:
        """Figures as ``PixelAnswer.numbers`` shows them."""
        return {"features_near": len(self.members), "nearest_feature_px": self.nearest_px}


def look_around(
    features_px: ArrayLike, px: tuple[float, float], camera: StereoCamera, apart_px: float = 0.0
) -> Nearby:
    """Find the features (N, 2) around a pixel.

    Args:
        apart_px: intended spacing of the features; if none is within the radius, the nearest one
            within this distance decides.
    """
    distance = distances(features_px, px)
    radius = radius_px(camera)
    order = np.argsort(distance, kind="stable")
    members = order[distance[order] <= radius]
    if len(members) == 0 and apart_px > radius:
        radius = apart_px
        members = order[:1][distance[order[:1]] <= radius]
    nearest = float(distance[order[0]]) if len(order) else None
    return Nearby(members, nearest, radius)


def radius_px(camera: StereoCamera) -> float:
    """Return the radius within which features decide for a pixel."""
    return max(_LEAST_RADIUS_PX, camera.width * _RADIUS_SHARE)


def distances(features_px: ArrayLike, px: tuple[float, float]) -> Float64Array:
    """Return the distances (N,), pixels; infinite where a feature's position is unknown."""
    gap = np.asarray(features_px, dtype=np.float64).reshape(-1, 2) - px
    return np.nan_to_num(np.hypot(gap[:, 0], gap[:, 1]), nan=np.inf)


def known(value: float) -> float | None:
    """Return a figure as an answer holds it: None for NaN and the infinities."""
    return float(value) if math.isfinite(value) else None


@functools.cache
def limits(parameter: str) -> tuple[float, float]:
    """Return the minimum and maximum of a numeric parameter, by its dotted name."""
    entry = next(entry for entry in Parameters.declared() if entry["name"] == parameter)
    return float(entry["minimum"]), float(entry["maximum"])


# A value in a sentence must be rounded to the right side of the exact one, or setting it would
# change nothing.


def below(value: float, digits: int = 2) -> str:
    """Return the greatest number with ``digits`` decimals that is less than ``value``."""
    scale = 10**digits
    return f"{(math.ceil(value * scale - 1e-6) - 1) / scale:.{digits}f}"


def above(value: float, digits: int = 2) -> str:
    """Return the least number with ``digits`` decimals that is greater than ``value``."""
    scale = 10**digits
    return f"{(math.floor(value * scale + 1e-6) + 1) / scale:.{digits}f}"
