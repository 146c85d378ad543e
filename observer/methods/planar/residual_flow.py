"""Step 6 of the method: features that still move after the image transformation are dynamic."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.methods.planar.results import ResidualFlow
from observer.parameters import FlowParameters
from observer.types import Image
from observer.vision.klt_tracking import track_points


def residual_flow(
    previous: Image,
    transformed: Image,
    valid: NDArray[np.bool_],
    px: NDArray[np.float32],
    parameters: FlowParameters,
) -> ResidualFlow:
    """Track features with Lucas-Kanade from the image at t to the transformed image of t+dt.

    Features are left out, and count neither as dynamic nor as static, where the tracking window
    would reach beyond the transformed image, where the surroundings differ too much, and where
    tracking back does not return to the start.

    Args:
        previous, transformed: (H, W) grey, both in the frame of t.
        valid: (H, W), where ``transformed`` is known.
        px: (N, 2) features at t.
    """
    reach = parameters.window_px // 2 + 1
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    usable = np.asarray(
        cv2.erode(valid.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=(0,)),
        dtype=np.bool_,
    )
    start = px[_at(usable, px)]
    end, kept = track_points(previous, transformed, start, parameters, back_check=True)
    kept &= _at(usable, end)
    start, end = start[kept], end[kept]
    dynamic = np.linalg.norm(end - start, axis=1) > parameters.residual_threshold_px
    return ResidualFlow(start, end, dynamic)


def _at(mask: NDArray[np.bool_], px: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) the mask's value at the nearest pixel, False outside."""
    height, width = mask.shape
    with np.errstate(invalid="ignore"):
        nearest = np.rint(px).astype(np.int64)
    inside = ((nearest >= 0) & (nearest < (width, height))).all(axis=1)
    nearest[~inside] = 0
    return np.asarray(inside & mask[nearest[:, 1], nearest[:, 0]], dtype=np.bool_)
