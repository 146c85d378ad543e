"""Views for display, drawn on copies from the observer's trace.

Colours are BGR. If a step had nothing to show in a frame, the picture says so instead of showing an
older one.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.dense_stereo import DensePair, DenseStereo
from app.engine.observed import Observed
from observer.drawing import (
    TEXT_SCALE,
    DrawnObstacle,
    color_copy,
    draw_obstacles,
    draw_text,
    hatch_unseen,
    obstacle_color,
)
from observer.image_files import jpeg
from observer.obstacle_labels import obstacle_label
from observer.types import Image, Obstacle

JPEG_QUALITY = 80
# Wider images are shrunk: no panel shows more, and every JPEG fits its slot.
MAX_WIDTH = 1280

_GREEN = (60, 220, 60)
_LIGHT_GREEN = (170, 255, 170)
_ORANGE = (40, 140, 255)
_RED = (60, 60, 255)
_DARK = (24, 24, 24)
_GREY = (150, 150, 150)
# Sub-pixel coordinates: OpenCV's drawing takes integers with this many fractional bits.
_SHIFT = 3
_STAR_ARM_PX = 3.0
# Width of a letter in pictures at the usual text scale.
_LETTER_PX = 8.0
# Models that transform images.
_TRANSFORMING = ("affine", "homography")
# Letters per line of a message: the text is scaled so that this many fit into the picture's width.
_LETTERS = 46
# Residual motion is a few pixels; this magnification makes it visible.
RESIDUAL_SCALE = 4.0


def draw_view(name: str, observed: Observed) -> bytes:
    """Draw a view as a JPEG.

    Args:
        name: any of ``app.contract.views.VIEW_NAMES`` but the disparity.
    """
    return encode_jpeg(_VIEWS[name](observed), fine_colors=name in _FINELY_DRAWN)


def draw_disparity(pair: DensePair, dense: DenseStereo | None) -> bytes:
    """Draw disparity as a JPEG of the pair's size: near is red, unknown is dark."""
    height, width = pair.left.shape[:2]
    if dense is None:
        return encode_jpeg(_nothing((height, width), "no disparity in this frame", pair.reasons))
    # The square root spreads the far part, where most of a scene lies; unknown becomes 0.
    share = np.nan_to_num(dense.disparity, nan=0.0) / dense.parameters.max_disparity_px
    level = cv2.convertScaleAbs(cv2.sqrt(share.clip(0.0, 1.0)), alpha=255.0)
    colors = np.asarray(cv2.applyColorMap(level, _disparity_colors()), dtype=np.uint8)
    if dense.coarseness > 1:
        # Keep coarse pixels visible: interpolation would smooth unmatched areas away.
        resized = cv2.resize(colors, (width, height), interpolation=cv2.INTER_NEAREST)
        colors = np.asarray(resized, dtype=np.uint8)
    return encode_jpeg(colors)


def encode_jpeg(image: Image, *, fine_colors: bool = False) -> bytes:
    """Encode a grey or BGR image as a JPEG, shrunk to ``MAX_WIDTH`` if it is wider.

    Args:
        fine_colors: keep the colours of one-pixel lines, for a quarter more bytes.
    """
    return jpeg.encode_jpeg(image, JPEG_QUALITY, most_width=MAX_WIDTH, fine_colors=fine_colors)


def jpeg_size(width: int, height: int) -> tuple[int, int]:
    """Return width and height of the JPEG of an image of this size."""
    return jpeg.shrunk_size(width, height, MAX_WIDTH)


def _left(observed: Observed) -> Image:
    """Draw the left image with feature stars, their flow since t, and the obstacles.

    Areas in which motion could go unnoticed are hatched.
    """
    trace = observed.trace
    canvas = color_copy(trace["left"])
    if observed.observation.unseen is not None:
        hatch_unseen(canvas, observed.observation.unseen)
    matches, ego_motion = trace.get("matches"), trace.get("ego_motion")
    if matches is not None and len(matches):
        inliers = None if ego_motion is None else ego_motion.inliers
        if inliers is None or len(inliers) != len(matches):
            inliers = np.ones(len(matches), dtype=np.bool_)
        flow = np.stack([matches.previous, matches.current], axis=1)
        _lines(canvas, flow[inliers], _LIGHT_GREEN)
        _lines(canvas, flow[~inliers], _ORANGE)
        _stars(canvas, matches.current, _GREEN)
    _obstacles(canvas, observed.observation.reported)
    return canvas


def _plain(observed: Observed) -> Image:
    image: Image = observed.trace["left"]
    return image


def _warped(observed: Observed) -> Image:
    warped = observed.trace.get("warped_left")
    model = observed.parameters.ego_motion.model
    if warped is None and model not in _TRANSFORMING:
        sentence = f"The method {model} does not warp the image; {' and '.join(_TRANSFORMING)} do."
        return _nothing(observed.trace["left"].shape[:2], sentence, ())
    if warped is None:
        return _nothing_of(observed, "no warped image in this frame")
    image: Image = warped
    return image


def _disparity_colors() -> Image:
    """Return (256, 1, 3) BGR colours: dark, then from far to near."""
    levels = np.arange(256, dtype=np.uint8).reshape(-1, 1)
    colors = np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_TURBO), dtype=np.uint8)
    colors[0] = _DARK
    return colors


def _residual(observed: Observed) -> Image:
    """Draw residual motion over the darkened image at t: motion not explained by the camera's own.

    Red arrows are dynamic features, grey ones are not.
    """
    trace = observed.trace
    start, residual = trace.get("flow_px"), trace.get("flow_residual_px")
    if start is None or residual is None:
        return _nothing_of(observed, "no residual flow in this frame")
    base = trace.get("previous_left")
    base = trace["left"] if base is None else base
    canvas = color_copy(np.asarray(cv2.convertScaleAbs(base, alpha=0.45), dtype=np.uint8))
    threshold = observed.parameters.flow.residual_threshold_px
    dynamic = trace.get("dynamic")
    if dynamic is None or len(dynamic) != len(start):
        dynamic = np.linalg.norm(residual, axis=1) > threshold
    tips = np.asarray(start) + RESIDUAL_SCALE * np.asarray(residual)
    arrows = np.stack([start, tips], axis=1)
    finite = np.isfinite(arrows).all(axis=(1, 2))
    for chosen, color in ((finite & ~dynamic, _GREY), (finite & dynamic, _RED)):
        _lines(canvas, arrows[chosen], color)
        _arrow_heads(canvas, arrows[chosen], color)
    return canvas


_VIEWS: Mapping[str, Callable[[Observed], Image]] = {
    "left": _left,
    "warped": _warped,
    "residual": _residual,
    "plain": _plain,
}

_FINELY_DRAWN = ("left", "residual")


def _nothing(size: tuple[int, int], sentence: str, reasons: tuple[str, ...]) -> Image:
    """Draw a dark picture of this height and width that says why it is dark."""
    height, width = size
    canvas = np.full((height, width, 3), _DARK, dtype=np.uint8)
    scale = TEXT_SCALE * max(1.0, width / _LETTERS / _LETTER_PX)
    lines = [line for text in (sentence, *reasons[:3]) for line in textwrap.wrap(text, _LETTERS)]
    for row, text in enumerate(lines):
        at = round(22 * scale / TEXT_SCALE) * (row + 1)
        draw_text(canvas, text, (8, at), _GREY, scale)
    return canvas


def _nothing_of(observed: Observed, sentence: str) -> Image:
    return _nothing(observed.trace["left"].shape[:2], sentence, observed.observation.reasons)


def _lines(
    canvas: Image, segments: NDArray[Any], color: tuple[int, int, int], thickness: int = 1
) -> None:
    """Draw segments (N, 2, 2), pixels: start and end. All in one call, which is faster."""
    if len(segments):
        points = np.round(np.asarray(segments) * (1 << _SHIFT)).clip(-(2**24), 2**24)
        cv2.polylines(
            canvas, list(points.astype(np.int32)), False, color, thickness, cv2.LINE_AA, _SHIFT
        )


def _stars(canvas: Image, px: NDArray[Any], color: tuple[int, int, int]) -> None:
    angles = np.deg2rad([0.0, 60.0, 120.0])
    arms = _STAR_ARM_PX * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    centers = np.asarray(px, dtype=np.float64)[:, None]
    _lines(canvas, np.stack([centers - arms, centers + arms], axis=2).reshape(-1, 2, 2), color)


def _arrow_heads(canvas: Image, arrows: NDArray[Any], color: tuple[int, int, int]) -> None:
    along = arrows[:, 1] - arrows[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    long_enough = length[:, 0] > 2.0
    along, tips = along[long_enough] / length[long_enough], arrows[long_enough, 1]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    for side in (across, -across):
        _lines(canvas, np.stack([tips, tips - 4.0 * along + 2.5 * side], axis=1), color)


def _obstacles(canvas: Image, obstacles: Iterable[Obstacle]) -> None:
    draw_obstacles(
        canvas,
        (
            DrawnObstacle(
                one.box_px,
                one.silhouette,
                obstacle_label(one.id, one.motion, one.speed),
                obstacle_color(one.state, one.motion),
            )
            for one in obstacles
        ),
    )
