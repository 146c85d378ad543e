"""Reasons why a place has no feature: nothing to see, or a feature that was left out."""

from __future__ import annotations

from typing import Any, cast

import cv2
import numpy as np

from observer.camera import as_gray
from observer.explanation.answer import Nearby, below, distances, limits
from observer.geometry import Float64Array
from observer.number_format import count_of
from observer.parameters import FeaturesParameters, FlowParameters, Parameters
from observer.trace import TraceValues
from observer.types import Image
from observer.vision.features import corners, detect_features
from observer.vision.klt_tracking import EIGENVALUE_UNIT

# FAST needs this margin around a corner, for its circle.
_FAST_REACH_PX = 4


def why_no_feature(
    trace: TraceValues, parameters: Parameters, px: Float64Array, near: Nearby
) -> tuple[str, str]:
    """Return the sentence, and what would change it.

    Args:
        px: (2,) the place in the image of t, where features are detected.
        near: the search result around it, without any members.
    """
    image = as_gray(trace["previous_left"])
    place = (float(px[0]), float(px[1]))
    found = np.flatnonzero(distances(trace["features_px"], place) <= near.radius_px)
    if len(found):
        return _not_followed(image, trace["features_px"][found], parameters.flow, near)
    sentence = f"There is no feature within {near.radius_px:.0f} px of here; {near.nearest}."
    return sentence, _to_get_one(image, place, parameters, near)


def _not_followed(
    image: Image, px: np.ndarray[Any, Any], flow: FlowParameters, near: Nearby
) -> tuple[str, str]:
    texture = float(_texture(image, px, flow.window_px).max())
    sentence = (
        f"{count_of(len(px), 'feature')} within {near.radius_px:.0f} px of here could not be "
        "tracked to the next image"
    )
    if texture < flow.min_texture:
        return (
            f"{sentence}: the texture, {texture:.2f} grey levels/px, is below "
            f"{flow.min_texture:g}.",
            f"With flow.min_texture at {below(max(texture, 0.01))} or below they would be "
            "tracked, though they may slide along edges.",
        )
    return (
        f"{sentence}: they are occluded, or this place has left the image.",
        f"A value of flow.max_error above {flow.max_error:g} or of flow.back_check_px above "
        f"{flow.back_check_px:g} px may let them through.",
    )


def texture_around(
    image: Image, place: tuple[float, float], radius_px: float, window_px: int
) -> float:
    """Return the largest texture around a place, grey levels/px in its least direction."""
    reach = np.arange(-int(radius_px), int(radius_px) + 1, 2, dtype=np.float32)
    u, v = (grid.ravel() for grid in np.meshgrid(reach, reach))
    inside = np.hypot(u, v) <= radius_px
    px = np.stack([u[inside] + place[0], v[inside] + place[1]], axis=1)
    height, width = image.shape
    fits = (px >= 0).all(axis=1) & (px < (width, height)).all(axis=1)
    return float(_texture(image, px[fits], window_px).max())


def _texture(image: Image, px: np.ndarray[Any, Any], window_px: int) -> Float64Array:
    """Return the texture (N,), grey levels/px in its least direction, as for ``min_texture``."""
    _, _, eigenvalue = cv2.calcOpticalFlowPyrLK(
        image,
        image,
        np.ascontiguousarray(px, dtype=np.float32),
        cast(Any, None),
        winSize=(window_px | 1, window_px | 1),
        maxLevel=0,
        flags=cv2.OPTFLOW_LK_GET_MIN_EIGENVALS,
        minEigThreshold=0.0,
    )
    value = np.asarray(eigenvalue, dtype=np.float64)[:, 0]
    return np.asarray(np.sqrt(np.maximum(value, 0.0) * EIGENVALUE_UNIT), dtype=np.float64)


def _to_get_one(
    image: Image, place: tuple[float, float], parameters: Parameters, near: Nearby
) -> str:
    """Say which setting would give a feature here, verified by running the detector with it."""
    features = parameters.features
    ways: list[str] = []
    if features.detector == "fast":
        score = _best_corner(image, place, near.radius_px)
        lowest, _ = limits("features.fast_threshold")
        if score is None or score < lowest:
            return (
                "Nothing here can be tracked, not even with features.fast_threshold at "
                f"{lowest:g}: only more texture or light would change this."
            )
        if score < features.fast_threshold:
            ways.append(
                f"features.fast_threshold at {score:.0f} or below (now {features.fast_threshold})"
            )
            features = features.model_copy(update={"fast_threshold": int(score)})
    if features.detector in ("shi_tomasi", "harris"):
        quality = _best_quality(image, place, near.radius_px, features)
        if quality is None:
            lowest, _ = limits("features.quality")
            return (
                f"There is no corner here, not even with features.quality at {lowest:g}: only more "
                "texture or light, or another features.detector, would change this."
            )
        if quality < features.quality:
            ways.append(f"features.quality at {quality:g} or below (now {features.quality:g})")
            features = features.model_copy(update={"quality": quality})
    count = _count_that_finds(image, place, features, near.radius_px)
    if count is None:
        return (
            "Features nearby are stronger, whatever features.max_count; more texture or light "
            "here, or another features.detector, may give one."
        )
    if count > features.max_count:
        ways.append(f"features.max_count at {count} or above (now {features.max_count})")
    if not ways:
        return "Features found here were rejected afterwards; ask again on the next frame."
    return f"With {' and '.join(ways)} there would be a feature here."


def _count_that_finds(
    image: Image, place: tuple[float, float], features: FeaturesParameters, radius_px: float
) -> int | None:
    """Return a max_count, from the current one up, that gives a feature here; None if none does."""
    most = int(limits("features.max_count")[1])
    count = features.max_count
    while True:
        found = detect_features(image, features.model_copy(update={"max_count": count}))
        if (distances(found.px, place) <= radius_px).any():
            return count
        if count >= most:
            return None
        count = min(most, count * 3 // 2)


def _best_corner(image: Image, place: tuple[float, float], radius_px: float) -> float | None:
    """Return the greatest FAST threshold that gives a corner around the place; None without one."""
    reach = int(np.ceil(radius_px)) + _FAST_REACH_PX
    u, v = (round(c) for c in place)
    left, top = max(0, u - reach), max(0, v - reach)
    part = image[top : max(0, v + reach + 1), left : max(0, u + reach + 1)]
    if part.size == 0:
        return None
    lowest, _ = limits("features.fast_threshold")
    corners = cv2.FastFeatureDetector.create(int(lowest)).detect(np.ascontiguousarray(part))
    scores = [
        corner.response
        for corner in corners
        if np.hypot(corner.pt[0] + left - place[0], corner.pt[1] + top - place[1]) <= radius_px
    ]
    return max(scores, default=None)


def _best_quality(
    image: Image, place: tuple[float, float], radius_px: float, features: FeaturesParameters
) -> float | None:
    """Return the greatest ``features.quality`` that gives a corner around the place; else None."""
    lowest, _ = limits("features.quality")
    everything = features.model_copy(update={"quality": lowest})
    px, strength = corners(image, everything, 0)
    at = distances(px, place) <= radius_px
    if not at.any():
        return None
    share = float(strength[at].max() / strength.max())
    # Rounded down to the digits that the panel shows, or the value shown might not work.
    return float(max(lowest, np.floor(share * 1e4) / 1e4))
