"""Step 3 of the method: match points between the images at t and t+dt."""

from __future__ import annotations

from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from observer.parameters import FlowParameters, MatchingParameters
from observer.types import Image, Matches
from observer.vision.features import Features
from observer.vision.klt_tracking import track_points
from observer.vision.surf import surf_descriptors

_Values = NDArray[np.integer[Any] | np.floating[Any]]

# ORB's own patch is 31 px; it pads the image itself, so points nearer to the border do no harm.
_ORB_EDGE_PX = 12
_ORB_PATCH_PX = 31.0
# Stands for "too far apart to be the same point"; larger than any descriptor distance.
_REFUSED = np.float32(1e9)


def match_descriptors(
    previous_image: Image,
    current_image: Image,
    previous: Features,
    current: Features,
    parameters: MatchingParameters,
) -> Matches:
    """Match features by their feature values, as the paper does.

    BRISK, KAZE, ORB and SURF points are compared by their own descriptors, all others by upright
    ORB descriptors (binary comparisons of grey levels around the point). Points further away
    than ``max_shift`` are not candidates, not even in the ratio test.

    Args:
        previous_image, current_image: (H, W) grey at t and t+dt.
        previous, current: the features of the two images.
    """
    px_previous, values_previous = _described(previous_image, previous)
    px_current, values_current = _described(current_image, current)
    if len(px_previous) == 0 or len(px_current) == 0:
        return Matches(np.empty((0, 2), np.float32), np.empty((0, 2), np.float32))
    distance = _distances(values_previous, values_current)
    shift = parameters.max_shift * previous_image.shape[1]
    gap = px_previous[:, None, :] - px_current[None, :, :]
    distance[np.einsum("ijk,ijk->ij", gap, gap) > shift * shift] = _REFUSED
    best = distance.argmin(axis=1)
    rows = np.arange(len(best))
    best_distance = distance[rows, best]
    kept = best_distance < _REFUSED
    if parameters.cross_check:
        kept &= distance.argmin(axis=0)[best] == rows
    distance[rows, best] = _REFUSED
    kept &= best_distance <= parameters.ratio * distance.min(axis=1)
    return Matches(px_previous[kept], px_current[best[kept]])


def track_features(
    previous_image: Image,
    current_image: Image,
    previous: Features,
    parameters: MatchingParameters,
    flow: FlowParameters,
) -> Matches:
    """Match features by tracking each one from t to t+dt with Lucas-Kanade (KLT).

    With ``cross_check`` each point is tracked back as well and must return to where it started,
    within the flow stage's ``back_check_px``.

    Args:
        previous_image, current_image: (H, W) grey at t and t+dt.
        previous: the features at t.
        flow: window, pyramid and limits of Lucas-Kanade.
    """
    start = previous.px
    end, kept = track_points(
        previous_image, current_image, start, flow, back_check=parameters.cross_check
    )
    shift = parameters.max_shift * previous_image.shape[1]
    kept &= np.linalg.norm(end - start, axis=1) <= shift
    return Matches(start[kept], end[kept])


def _described(image: Image, features: Features) -> tuple[NDArray[np.float32], _Values]:
    # The extractor may drop points without a full patch, so it returns the ones it kept.
    if features.keypoints is not None and features.detector == "surf":
        return surf_descriptors(image, features.keypoints)
    if features.keypoints is None:
        keypoints = cv2.KeyPoint.convert(cast(Any, features.px), _ORB_PATCH_PX)
    else:
        keypoints = features.keypoints
    kept, values = _extractor(features).compute(image, keypoints)
    # compute() returns None if no point is left; the type stubs do not say so.
    if cast(Any, values) is None:
        return np.empty((0, 2), np.float32), np.empty((0, 1), np.uint8)
    return np.asarray(cv2.KeyPoint.convert(kept), np.float32).reshape(-1, 2), np.asarray(values)


def _extractor(features: Features) -> cv2.Feature2D:
    if features.keypoints is None:
        return cv2.ORB.create(edgeThreshold=_ORB_EDGE_PX)
    match features.detector:
        case "brisk":
            return cv2.BRISK.create()
        case "kaze":
            return cv2.KAZE.create()
        case _:
            return cv2.ORB.create()


def _distances(a: _Values, b: _Values) -> NDArray[np.float32]:
    """(N, M) distances: Hamming of binary, Euclidean of real descriptors."""
    if a.dtype != np.uint8:
        return np.asarray(cdist(a, b), dtype=np.float32)
    # With bits as +1 and -1 the product counts equal bits minus different ones. All terms are
    # integers, so the result is exact in any order of summation.
    bits = (np.unpackbits(values.astype(np.uint8), axis=1) for values in (a, b))
    x, y = (2 * b.astype(np.float32) - 1 for b in bits)
    return np.asarray((x.shape[1] - x @ y.T) / 2, dtype=np.float32)
