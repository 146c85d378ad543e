"""Segments of whole people, even if only an arm of them moves or half of them is plain."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array
from observer.methods.rigid.dense.height import stands
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import (
    LEAST_CELLS,
    SEGMENT_M2,
    UPRIGHT,
    Mask,
    Segment,
    extent_m,
    grown_mask,
    least_cells,
    segment_of,
)
from observer.robust import median

# Metres from a moving part within which more of its body lies, and all of it.
_BESIDE_M, _BODY_M = 0.75, 1.8
# A person, arms included: metres, least height seen, and most width and height.
_LEAST_HEIGHT_M, _MOST_WIDTH_M, _MOST_HEIGHT_M = 0.8, 1.6, 2.4
# An arm is at most this share of a person, who stands while more than this share of them is static.
_ARM_SHARE, _STATIC_SHARE = 0.35, 0.6
# Head and shoulders are in this upper share of the rows: arms swing below it.
SHOULDERS_SHARE = 0.35
# Cosine of a camera's tilt up to which what is above in the image is above in the world.
_LEVEL = 0.9


def is_person(segment: Segment, scene: DenseScene) -> bool:
    """Return whether a segment stands apart, and is as large and as upright as a person."""
    width, height = extent_m(segment, scene.grid)
    upright = _LEAST_HEIGHT_M < height < _MOST_HEIGHT_M and width < min(_MOST_WIDTH_M, height)
    return segment.is_separate and upright


def whole_person(scene: DenseScene, part: Segment, free: Mask) -> Segment:
    """Return the standing person whose arm a segment is; else the segment itself.

    Args:
        free: (h, w) cells that belong to nothing yet, those of the segment among them.
    """
    if _is_low_and_broad(part, scene):
        return part
    column, row = part.columns[1], (part.box[1] + part.box[3] - 1) / 2
    px = scene.grid.to_px(np.array([[column, row]]))
    at = scene.grid.camera.triangulate(px, np.array([part.disparity]))[0]
    whole = standing_segment(scene, scene.T_world_camera.apply(at), free | part.mask)
    if whole is None or not is_person(whole, scene) or part.area > _ARM_SHARE * whole.area:
        return part
    return whole if whole.static > _STATIC_SHARE else part


def _is_low_and_broad(segment: Segment, scene: DenseScene) -> bool:
    """Return whether a segment stands on the ground and is no arm or leg: a robot at a wall."""
    if scene.ground is None or segment.cut[3]:
        return False
    width, height = extent_m(segment, scene.grid)
    return height <= UPRIGHT * width and stands(segment, scene, scene.ground)


def standing_segment(scene: DenseScene, place: Float64Array, free: Mask) -> Segment | None:
    """Return the segment of what stands at a place (3,) m, world, or beside it; None if nothing.

    Args:
        free: (h, w) cells that belong to nothing yet.
    """
    grid = scene.grid
    px, disparity = grid.camera.project(scene.T_camera_world.apply(place[None]))
    if not np.isfinite(px).all():
        return None
    d = float(disparity[0])
    column, row = np.round(grid.to_cells(px[0])).astype(int).tolist()
    mask = None
    for reach_m in (_BESIDE_M, _BODY_M):
        reach = max(2, round(reach_m * grid.per_metre(d)))
        near = np.zeros(grid.shape, np.bool_)
        near[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1] = (
            True
        )
        seed = near & free & scene.standing if mask is None else mask
        mask = grown_mask(scene, scene.standing & free & near, seed, near, d)
        if mask is None:
            return None
        d = median(scene.disparity[mask])
    assert mask is not None
    if np.count_nonzero(mask) < least_cells(scene, SEGMENT_M2, d):
        return None
    return segment_of(scene, mask)


def with_head(scene: DenseScene, body: Segment, free: Mask) -> Segment:
    """Return the segment of a walking person, with head and shoulders if it lacks them.

    Plain cloth before a plain wall looks the same wherever it is, and so seems to stand. What is
    above a body at its depth is part of it, unless nothing beside that is farther, as at a wall.
    Nothing is looked for unless the camera is known to look level.

    Args:
        free: (h, w) cells that belong to nothing yet, or to the body.
    """
    left, top, right, bottom = body.box
    _, height_m = extent_m(body, scene.grid)
    missing = round((_MOST_HEIGHT_M - height_m) * scene.grid.per_metre(body.disparity))
    if body.cut[2] or missing <= 0 or not _looks_level(scene):
        return body
    end = top + max(1, round(SHOULDERS_SHARE * (bottom - top)))
    near = body.mask.copy()
    near[max(0, top - missing) : end, left:right] = True
    free = scene.standing & free & near
    mask = grown_mask(scene, free, body.mask, near, body.disparity)
    if mask is None or np.count_nonzero(mask) < body.area + LEAST_CELLS:
        return body
    whole = segment_of(scene, mask)
    return whole if whole.is_separate and whole.apart >= body.apart else body


def _looks_level(scene: DenseScene) -> bool:
    if scene.ground is None:
        return False
    return bool(scene.ground.mapped(scene.T_camera_world).down[1] > _LEVEL)
