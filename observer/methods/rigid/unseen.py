"""Places in a frame where motion would go unnoticed, and why.

Motion is noticed where depth is known or a point is tracked. All other cells are *unseen*, and
their share is always reported. Most of them are plain walls and floors: a person walking in front
of them shows an outline, and an outline has depth. So a plain region counts as background while
nearly everything known around it is ground or static. If the remaining unseen cells could hide a
person, the status is degraded: a window of a person's size is unseen by half or more.

A mover of exactly the same tone as a plain background shows no outline; only the unseen share
accounts for it.

Something that may move but is not certain enough to be reported yet is marked as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.kernels.unseen import background, cell_means, fills, told_by_points
from observer.methods.rigid.dense.depth_image import RowTexture
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import StereoParameters
from observer.types import UNSEEN_BECAUSE, BoxPx, Image, Unseen
from observer.vision.view import View

Mask = NDArray[np.bool_]
Weights = NDArray[np.float32]
# One per cell: the first letter of the cause why motion is unseen; "." where motion is seen.
Letters = NDArray[np.uint8]

# Side of a cell, in cells of the dense grid; and the share of it that must have depth.
_SIDE = 8
_SEEN_SHARE = 0.25
_HALF = 0.5
# An outline differs from its background by this share of the grey level; from this grey level on
# a pixel is saturated.
_CONTRAST = 0.25
_WHITE = 250
# Metres: width and height of the part of a person that must fit in, and its distance.
_PERSON_M = (0.4, 1.0)
_PERSON_AWAY_M = 3.0
# Unseen share of a window that hides a person: below it most of the outline is seen.
_HIDING_SHARE = 0.5
# Unmatched share of a person's window from which on objects that are too near are searched for.
_UNMATCHED_SHARE = 0.25
# Depths nearer than the usual search range are searched for in images reduced by this factor, up
# to this multiple of the maximum disparity.
_NEAR_REDUCTION = 4
_NEAR_REACH = 2.3
_NEAR_BLOCK, _NEAR_UNIQUENESS_PERCENT, _NEAR_TEXTURE = 9, 15, 200
# Chance matches are smaller than this. A cell with depth on this share of it has the right depth.
_NEAR_LEAST, _SOLID_SHARE = np.ones((3, 3), np.uint8), 0.9


class UnseenRegions:
    """Finds where motion would go unnoticed, frame by frame."""

    def __init__(self, camera: StereoCamera) -> None:
        self._grid = Grid.of(camera)
        self._fits = _person_cells(self._grid)

    def look(
        self,
        view: View,
        scene: DenseScene | None,
        points: TrackedPoints,
        reported: Sequence[BoxPx],
        tentative: Sequence[BoxPx],
        parameters: StereoParameters,
    ) -> Unseen:
        """Find where motion would go unnoticed in a view.

        Args:
            scene: of this frame; None while the camera is too fast for it.
            points: as tracked in this frame.
            reported: u0, v0, u1, v1 px around obstacles reported as seen in this frame.
            tentative: around what may be moving; marked as tentative.
        """
        grid = self._grid
        small = grid.reduced(view.left) if scene is None else scene.left
        texture = RowTexture.of(small) if scene is None else scene.texture
        plain = _shares(texture.near) < _HALF
        dark = (_CONTRAST * _shares(small) < texture.step) | (_shares(small >= _WHITE) >= _HALF)
        known, static, moves = _known(scene, points, grid, plain.shape)
        cause = np.full(plain.shape, ord("f" if scene is None else "u"), np.uint8)
        cause[plain] = ord("p")
        cause[dark] = ord("d")
        cause[known >= _SEEN_SHARE] = ord(".")
        if self._fill(cause == ord("u"), _UNMATCHED_SHARE):
            cause[_near(view, parameters.max_disparity_px, known)] = ord("n")
        on_reported = _within(reported, grid, plain.shape)
        moves[on_reported] = 0
        hidden = (cause != ord(".")) & ~self._background(cause == ord("p"), static, moves)
        hides = self._fill(hidden & ~on_reported, _HIDING_SHARE)
        cause[_within(tentative, grid, plain.shape) & ~on_reported] = ord("t")
        return _summarized(cause, _SIDE * grid.reduction, hides=hides)

    def _fill(self, cells: Mask, share: float) -> bool:
        """Return whether the cells (rows, columns) fill this share of any person-sized window."""
        return fills(cells, *self._fits, share)

    def _background(self, plain: Mask, static: Weights, moves: Weights) -> Mask:
        """Return the cells of plain regions around which nearly everything known is static."""
        count, regions = cv2.connectedComponents(plain.view(np.uint8), connectivity=4)
        return background(regions.astype(np.int64), count, static, moves, *self._fits)


def _summarized(cause: Letters, cell_px: int, *, hides: bool) -> Unseen:
    counts = np.bincount(cause.ravel(), minlength=256) / cause.size
    shares = {name: float(counts[ord(name[0])]) for name in UNSEEN_BECAUSE}
    ordered = sorted(shares, key=lambda name: -shares[name])
    return Unseen(
        share=float(np.mean((cause != ord(".")) & (cause != ord("t")))),
        causes={name: shares[name] for name in ordered if shares[name] > 0},
        cell_px=cell_px,
        rows=tuple(row.tobytes().decode() for row in cause),
        hides_person=hides,
    )


def _shares(values: NDArray[np.bool_] | Image) -> Weights:
    """Means (rows, columns) over the cells of values (h, w) on the dense grid."""
    return cell_means(values.view(np.uint8), _SIDE)


def _known(
    scene: DenseScene | None, points: TrackedPoints, grid: Grid, shape: tuple[int, ...]
) -> tuple[Weights, Weights, Weights]:
    """Return the shares (rows, columns) of the cells whose depth is known, static and moving.

    What was not in view before counts as neither static nor moving, unless a point is tracked.
    """
    known = static = moves = np.zeros(shape, np.float32)
    if scene is not None:
        depth, evidence = np.isfinite(scene.disparity), scene.evidence
        known = _shares(depth)
        static = _shares(depth & (~scene.standing | (evidence == STATIC)))
        moves = _shares((evidence == ARRIVED) | (evidence == UNCOVERED))
    # A point seen only once, or by one camera only, is no evidence of motion.
    tells = (points.sightings > 1) & np.isfinite(points.disparity) & points.telling
    side_px, least = np.float32(_SIDE * grid.reduction), np.float32(_SEEN_SHARE)
    px, dynamic = points.px[tells], points.dynamic[tells]
    return told_by_points(known, static, moves, px, dynamic, side_px, least)


def _within(boxes: Sequence[BoxPx], grid: Grid, shape: tuple[int, ...]) -> Mask:
    """Cells (rows, columns) in boxes u0, v0, u1, v1 px."""
    inside = np.zeros(shape, np.bool_)
    side = _SIDE * grid.reduction
    for box in boxes:
        u0, v0, u1, v1 = (int(edge // side) for edge in box)
        inside[max(0, v0) : max(0, v1 + 1), max(0, u0) : max(0, u1 + 1)] = True
    return inside


def _person_cells(grid: Grid) -> tuple[int, int]:
    """Return the rows and columns of a person-sized window."""
    side = _SIDE * grid.reduction * _PERSON_AWAY_M
    across, down = _PERSON_M
    return (
        max(1, round(down * grid.camera.fy / side)),
        max(1, round(across * grid.camera.fx / side)),
    )


def _near(view: View, max_disparity_px: int, known: Weights) -> Mask:
    """Return the cells (rows, columns) that match at disparities beyond the search range.

    Objects that are too near are matched wrongly in places, so part of their depth seems known.
    If nearly all of it is known, the larger disparity is the wrong one, as with a repetitive
    pattern.
    """
    reduction = _NEAR_REDUCTION
    size = (view.left.shape[1] // reduction, view.left.shape[0] // reduction)
    least = -(-max_disparity_px // reduction)
    count = max(1, round((_NEAR_REACH - 1) * least / 16)) * 16
    matcher = cv2.StereoBM.create(count, _NEAR_BLOCK)
    matcher.setMinDisparity(least)
    matcher.setUniquenessRatio(_NEAR_UNIQUENESS_PERCENT)
    matcher.setTextureThreshold(_NEAR_TEXTURE)
    pair = (cv2.resize(i, size, interpolation=cv2.INTER_AREA) for i in (view.left, view.right))
    found = np.asarray(matcher.compute(*pair)) >= 16 * least
    share = cv2.resize(found.astype(np.float32), known.shape[::-1], interpolation=cv2.INTER_AREA)
    matched = cv2.morphologyEx((share >= _HALF).astype(np.uint8), cv2.MORPH_OPEN, _NEAR_LEAST)
    count, labels = cv2.connectedComponents(matched, connectivity=4)
    solid = np.bincount(labels.ravel(), (known >= _SOLID_SHARE).ravel(), count)
    near = solid < _HALF * np.bincount(labels.ravel(), minlength=count)
    near[0] = False
    return np.asarray(near[labels])
