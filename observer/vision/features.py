"""Step 2 of the method: feature points on the image at t, spread over the image in buckets."""

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

# The grid shares the points out after detection, so more than are wanted must be found first.
_CANDIDATES_PER_FEATURE = 4
_MIN_DISTANCE_PX = 4
# KAZE's own default (1e-3) leaves dark, weakly textured surfaces without a single point.
_KAZE_THRESHOLD = 1e-4
# MSER by OpenCV's defaults is for few, large regions; what is followed is a small window, so here
# they are small (pixels), weaker (grey levels) and may lie one in another.
_MSER = {"delta": 2, "min_area": 10, "max_area": 400, "max_variation": 0.5, "min_diversity": 0.1}
# Relative to the strongest corner: as good as any at all.
_LEAST_QUALITY = 1e-6


@dataclass(frozen=True, eq=False)
class Features:
    """N feature points of one image.

    Attributes:
        px: (N, 2) float32 pixels.
        keypoints: the same points as OpenCV's detector described them (scale, angle), which its
            own descriptor needs; None for detectors that have no descriptor of their own.
        detector: the detector's name.
    """

    px: NDArray[np.float32]
    keypoints: tuple[Any, ...] | None
    detector: str

    def __len__(self) -> int:
        return len(self.px)


def detect_features(image: Image, parameters: FeaturesParameters) -> Features:
    """Find feature points on a grey (H, W) image.

    ``fast`` is the paper's choice; ``shi_tomasi`` is its minimum eigenvalue and ``harris`` its
    Harris-Stephens detector. An image without texture gives no features, never an error.

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
    """Feature points (N, 2) px wherever they are, the strongest first.

    A corner may be as weak as it will: the strongest of the whole image says nothing of others.

    Args:
        image: (H, W) grey. most: so many are enough, for detectors that can be told so.

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

    A well textured obstacle would otherwise hold most of the points and be taken for the
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
    # Shares are rounded up; the weakest of the fullest cells make room.
    last = np.lexsort((px[order, 0], px[order, 1], -response[order], rank))
    return np.asarray(order[last[:max_count]], dtype=np.intp)


def _candidates(
    image: Image, parameters: FeaturesParameters, most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], Sequence[cv2.KeyPoint]]:
    """Pixels (N, 2), strengths (N,), and the points as the detector describes them, if it does."""
    if parameters.detector in ("shi_tomasi", "harris"):
        return *corners(image, parameters, most), ()
    if parameters.detector == "surf":
        keypoints: Sequence[cv2.KeyPoint] = surf_points(image, most)
    else:
        keypoints = _detector(parameters, most).detect(image)
    px = np.asarray(cv2.KeyPoint.convert(keypoints), dtype=np.float32).reshape(-1, 2)
    # MSER knows no strength; the larger region is the more stable one.
    strength = attrgetter("size" if parameters.detector == "mser" else "response")
    return px, np.fromiter(map(strength, keypoints), np.float32, len(keypoints)), keypoints


def corners(
    image: Image, parameters: FeaturesParameters, most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Corners (N, 2) px of ``shi_tomasi`` or ``harris``, and their strengths (N,).

    Args:
        image: (H, W) grey. most: so many at most, the strongest first; 0 for all.
    """
    found, quality = cv2.goodFeaturesToTrackWithQuality(
        image,
        most,
        parameters.quality,
        _MIN_DISTANCE_PX,
        cast(Any, None),
        useHarrisDetector=parameters.detector == "harris",
    )
    # None where there is no corner at all, which the type stubs do not know.
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
