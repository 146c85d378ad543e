"""Step 2 of the method: feature points in the image at t, spread over the image in buckets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import FeaturesParameters
from observer.types import Image
from observer.vision.surf import surf_points

# The grid selects points after detection, so more than wanted must be detected first.
_CANDIDATES_PER_FEATURE = 4
_MIN_DISTANCE_PX = 4
# KAZE's own default (1e-3) leaves dark, weakly textured surfaces without a single point.
_KAZE_THRESHOLD = 1e-4
# OpenCV's MSER defaults are for few, large regions; small windows are tracked, so here regions are
# small (pixels), weaker (grey levels) and may be nested.
_MSER = {"delta": 2, "min_area": 10, "max_area": 400, "max_variation": 0.5, "min_diversity": 0.1}
# Relative to the strongest corner; accepts practically any corner.
_LEAST_QUALITY = 1e-6


@dataclass(frozen=True, eq=False)
class Features:
    """N feature points of one image.

    Attributes:
        px: (N, 2) float32 pixels.
        keypoints: the same points as OpenCV's detector returned them (scale, angle), which its
            own descriptor needs; None for detectors without a descriptor of their own.
        detector: the detector's name.
    """

    px: NDArray[np.float32]
    keypoints: tuple[Any, ...] | None
    detector: str

    def __len__(self) -> int:
        return len(self.px)


def detect_features(image: Image, parameters: FeaturesParameters) -> Features:
    """Find feature points in a grey (H, W) image.

    ``fast`` is the paper's choice; ``shi_tomasi`` is its minimum eigenvalue and ``harris`` its
    Harris-Stephens detector. An image without texture gives no features, not an error.

    Raises:
        InputError: ``surf`` is asked for and its extra is not installed.
    """
    most = parameters.max_count * _CANDIDATES_PER_FEATURE
    px, response, keypoints = _candidates(image, parameters, most)
    height, width = image.shape
    kept = spread(px, response, (width, height), parameters.grid_cells, parameters.max_count)
    native = parameters.detector in ("brisk", "kaze", "orb", "surf")
    return Features(
        px=px[kept],
        keypoints=tuple(keypoints[i] for i in kept) if native else None,
        detector=parameters.detector,
    )


def strongest_first(image: Image, parameters: FeaturesParameters, most: int) -> NDArray[np.float32]:
    """Return feature points (N, 2) px from the whole image, the strongest first.

    Weak corners are included: the strength of the image's strongest one does not matter here.

    Args:
        image: (H, W) grey. most: enough points, for detectors that can limit them.

    Raises:
        InputError: ``surf`` is asked for and its extra is not installed.
    """
    weak = parameters.model_copy(update={"quality": _LEAST_QUALITY})
    px, response, _ = _candidates(image, weak, most)
    # Ties are broken by position, so that equal images give equal points.
    return px[np.lexsort((px[:, 0], px[:, 1], -response))]


def spread(
    px: NDArray[np.float32],
    response: NDArray[np.float32],
    size: tuple[int, int],
    columns: int,
    max_count: int,
) -> NDArray[np.intp]:
    """Select the points to keep so that every cell of a grid gets an equal share.

    Otherwise a well textured obstacle could hold most of the points and be mistaken for the
    background.

    Args:
        px: (N, 2) pixels. response: (N,) strength. size: image width and height.
        columns: number of columns of square cells. max_count: most points kept.

    Returns:
        Indices into ``px``; ties are broken by position, so the result does not depend on order.
    """
    width, height = size
    side = width / columns
    rows = max(1, round(height / side))
    column = np.clip((px[:, 0] / side).astype(np.intp), 0, columns - 1)
    row = np.clip((px[:, 1] * rows / height).astype(np.intp), 0, rows - 1)
    cell = row * columns + column
    order = np.lexsort((px[:, 0], px[:, 1], -response, cell))
    starts = np.searchsorted(cell[order], np.arange(rows * columns))
    rank = np.arange(len(order)) - starts[cell[order]]
    share = max(1, -(-max_count // (rows * columns)))
    order, rank = order[rank < share], rank[rank < share]
    # Shares are rounded up; the weakest points of the fullest cells are dropped.
    last = np.lexsort((px[order, 0], px[order, 1], -response[order], rank))
    return np.asarray(order[last[:max_count]], dtype=np.intp)


def _candidates(
    image: Image, parameters: FeaturesParameters, most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], Sequence[cv2.KeyPoint]]:
    """Return pixels (N, 2), strengths (N,), and the detector's keypoints, if it has any."""
    if parameters.detector in ("shi_tomasi", "harris"):
        return *corners(image, parameters, most), ()
    if parameters.detector == "surf":
        keypoints: Sequence[cv2.KeyPoint] = surf_points(image, most)
    else:
        keypoints = _detector(parameters, most).detect(image)
    px = np.asarray(cv2.KeyPoint.convert(keypoints), dtype=np.float32).reshape(-1, 2)
    # MSER has no strength; larger regions are more stable.
    strength = attrgetter("size" if parameters.detector == "mser" else "response")
    return px, np.fromiter(map(strength, keypoints), np.float32, len(keypoints)), keypoints


def corners(
    image: Image, parameters: FeaturesParameters, most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return corners (N, 2) px of ``shi_tomasi`` or ``harris``, and their strengths (N,).

    Args:
        image: (H, W) grey. most: largest number, the strongest first; 0 for all.
    """
    found, quality = cv2.goodFeaturesToTrackWithQuality(
        image,
        most,
        parameters.quality,
        _MIN_DISTANCE_PX,
        cast(Any, None),
        useHarrisDetector=parameters.detector == "harris",
    )
    # OpenCV returns None if there is no corner at all; the type stubs do not say so.
    if cast(Any, found) is None:
        return np.empty((0, 2), np.float32), np.empty(0, np.float32)
    px = np.asarray(found, dtype=np.float32).reshape(-1, 2)
    return px, np.asarray(quality, dtype=np.float32).reshape(-1)


def _detector(parameters: FeaturesParameters, most: int) -> cv2.Feature2D:
    match parameters.detector:
        case "fast":
            return cv2.FastFeatureDetector.create(parameters.fast_threshold)
        case "orb":
            return cv2.ORB.create(most, fastThreshold=parameters.fast_threshold)
        case "brisk":
            return cv2.BRISK.create(parameters.fast_threshold)
        case "kaze":
            return cv2.KAZE.create(threshold=_KAZE_THRESHOLD)
        case "mser":
            return cv2.MSER.create(**cast(Any, _MSER))
        case other:
            raise AssertionError(f"{other} has no Feature2D")
