"""Where motion could not be noticed in a frame, and why.

Motion is noticed where depth is known or a point is tracked. All other cells are *unseen*, and
their share is always told. Most of them are plain walls and floors: who walks there shows an
outline, and an outline has depth. So a plain region counts as background while nearly all that is
known around it is ground or was there before. Of what remains, the status is degraded where a
person would fit in: where a window of a person's size is unseen by half or more.

A mover of the very tone of a plain background shows no outline; only the share tells of it.

Where something seems to move but is not certain enough to be reported yet, that is told as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.methods.rigid.dense.depth_image import least_step, textured
from observer.methods.rigid.dense.free_space import ARRIVED, HIDDEN, STATIC
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import StereoParameters
from observer.types import UNSEEN_BECAUSE, Image, Obstacle, TrackState, Unseen
from observer.vision.view import View

Mask = NDArray[np.bool_]
Weights = NDArray[np.float32]

# Standard deviations of its velocity and number of points from which on something seems to move.
_SEEMING_SIGMAS, _SEEMING_POINTS = 2.0, 6
# Side of a cell, in cells of the dense grid; and the share of it that must have depth.
_SIDE = 8
_SEEN_SHARE = 0.25
_HALF = 0.5
# An outline differs from what is behind it by this share of the grey level; saturated is above.
_CONTRAST = 0.25
_WHITE = 250
# The part of a person that must fit in, width and height, metres; and from how far, metres.
_PERSON_M = (0.4, 1.0)
_PERSON_AWAY_M = 3.0
# Share of its window that hides a person: of less than that most of the outline is seen.
_HIDING_SHARE = 0.5
# Share of what is known around a plain region that must stand, around it all and nearby.
_STANDING_AROUND, _STANDING_NEARBY = 0.8, 0.5
# Share of a plain region's border that must be known to stand.
_KNOWN_BORDER = 0.25
# Share of a person's window that must be unmatched to look for what is too near.
_UNMATCHED_SHARE = 0.25
# Depths nearer than those searched are looked for in pictures so much smaller, up to so many times
# their disparity.
_NEAR_REDUCTION = 4
_NEAR_REACH = 2.3
_NEAR_BLOCK, _NEAR_UNIQUENESS_PERCENT, _NEAR_TEXTURE = 9, 15, 200
# What matches by chance is smaller; of what is known on this share of a cell the depth is right.
_NEAR_LEAST, _SOLID_SHARE = np.ones((3, 3), np.uint8), 0.9


class UnseenRegions:
    """Tells where motion could not be noticed, frame by frame."""

    def __init__(self, camera: StereoCamera) -> None:
        self._grid = Grid.of(camera)
        self._fits = _person_cells(self._grid)

    def look(
        self,
        view: View,
        scene: DenseScene | None,
        points: TrackedPoints,
        obstacles: Sequence[Obstacle],
        parameters: StereoParameters,
    ) -> Unseen:
        """Tell where motion could not be noticed in a view.

        Args:
            scene: of this frame; None while the camera is too fast for it.
            points: as tracked in this frame.
            obstacles: of this frame. That the confirmed ones move is told already; of tentative
                ones that may move it is told that this is not certain yet.
        """
        grid = self._grid
        small = grid.reduced(view.left) if scene is None else scene.left
        step = least_step(small)
        plain = _shares(textured(small, step)) < _HALF
        dark = (_CONTRAST * _shares(small) < step) | (_shares(small >= _WHITE) >= _HALF)
        known, stands, moves = _known(scene, points, grid, plain.shape)
        cause = np.full(plain.shape, "f" if scene is None else "u")
        cause[plain] = "p"
        cause[dark] = "d"
        cause[known >= _SEEN_SHARE] = "."
        if _fills(cause == "u", self._fits, _UNMATCHED_SHARE):
            cause[_near(view, parameters.max_disparity_px, known)] = "n"
        confirmed = [o for o in obstacles if o.state is TrackState.CONFIRMED]
        reported = _within(confirmed, grid, plain.shape)
        moves[reported] = 0
        background = _background(cause == "p", stands, moves, self._fits)
        hidden = (cause != ".") & ~background & ~reported
        hides = _fills(hidden, self._fits, _HIDING_SHARE)
        uncertain = _within([o for o in obstacles if _may_move(o)], grid, plain.shape)
        cause[uncertain & ~reported] = "t"
        return _told(cause, _SIDE * grid.reduction, hides=hides)


def _told(cause: NDArray[np.str_], cell_px: int, *, hides: bool) -> Unseen:
    shares = {name: float(np.mean(cause == name[0])) for name in UNSEEN_BECAUSE}
    ordered = sorted(shares, key=lambda name: -shares[name])
    return Unseen(
        share=float(np.mean((cause != ".") & (cause != "t"))),
        causes={name: shares[name] for name in ordered if shares[name] > 0},
        cell_px=cell_px,
        rows=tuple("".join(row) for row in cause.tolist()),
        hides_person=hides,
    )


def _shares(values: NDArray[np.bool_] | Image) -> Weights:
    """Means (rows, columns) over the cells of values (h, w) on the dense grid."""
    height, width = values.shape
    rows, columns = -(-height // _SIDE), -(-width // _SIDE)
    whole = cv2.copyMakeBorder(
        np.asarray(values, np.float32), 0, rows * _SIDE - height, 0, columns * _SIDE - width,
        cv2.BORDER_REPLICATE,
    )  # fmt: skip
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)


def _known(
    scene: DenseScene | None, points: TrackedPoints, grid: Grid, shape: tuple[int, ...]
) -> tuple[Weights, Weights, Weights]:
    """Shares (rows, columns) of the cells where depth is known, stands, and moves.

    What was not in view before neither stands nor moves, unless a point tells.
    """
    known = stands = moves = np.zeros(shape, np.float32)
    if scene is not None:
        depth, evidence = np.isfinite(scene.disparity), scene.evidence
        known = _shares(depth)
        stands = _shares(depth & (~scene.standing | (evidence == STATIC)))
        moves = _shares((evidence == ARRIVED) | (evidence == HIDDEN))
    # A point that was seen once, or by one camera only, tells no motion.
    tells = (points.sightings > 1) & np.isfinite(points.disparity) & points.cornered
    rows, columns = (at // _SIDE for at in grid.at(points.px[tells]))
    still, dynamic = np.zeros(shape, np.bool_), points.dynamic[tells]
    moving = still.copy()
    still[rows[~dynamic], columns[~dynamic]] = True
    moving[rows[dynamic], columns[dynamic]] = True
    known = np.where(still | moving, np.maximum(known, np.float32(_SEEN_SHARE)), known)
    stands = np.where(still & ~moving & (moves == 0), known, stands)
    return known, stands, np.where(moving, known, moves)


def _may_move(obstacle: Obstacle) -> bool:
    """Return whether something seems to move, but not surely enough to be reported."""
    if obstacle.state is not TrackState.TENTATIVE or obstacle.significance < _SEEMING_SIGMAS:
        return False
    return obstacle.silhouette is not None or obstacle.points >= _SEEMING_POINTS


def _within(obstacles: Sequence[Obstacle], grid: Grid, shape: tuple[int, ...]) -> Mask:
    """Cells (rows, columns) in the obstacles' boxes."""
    inside = np.zeros(shape, np.bool_)
    side = _SIDE * grid.reduction
    for obstacle in obstacles:
        u0, v0, u1, v1 = (max(0, int(edge // side)) for edge in obstacle.box_px)
        inside[v0 : v1 + 1, u0 : u1 + 1] = True
    return inside


def _background(plain: Mask, stands: Weights, moves: Weights, fits: tuple[int, int]) -> Mask:
    """Cells (rows, columns) of plain regions around which nearly all that is known stands."""
    count, labels = cv2.connectedComponents(plain.view(np.uint8), connectivity=4)
    rows, columns = labels.shape
    wide = np.pad(labels, 1)
    around = np.zeros((3, count))
    for down, across in ((0, 1), (2, 1), (1, 0), (1, 2)):
        beside = wide[down : down + rows, across : across + columns][~plain]
        for sums, weights in zip(around, (stands, moves, np.ones_like(stands)), strict=True):
            sums += np.bincount(beside, weights[~plain], count)
    still, moving, border = around
    sure = (still > 0) & (still >= _KNOWN_BORDER * border)
    sure &= still >= _STANDING_AROUND * (still + moving)
    sure[0] = False
    size = (2 * (fits[0] // 2) + 1, 2 * (fits[1] // 2) + 1)
    near, moved = (
        cv2.boxFilter(w, -1, size, borderType=cv2.BORDER_CONSTANT) for w in (stands, moves)
    )
    return np.asarray(sure[labels] & (near >= _STANDING_NEARBY * (near + moved)))


def _person_cells(grid: Grid) -> tuple[int, int]:
    """Columns and rows of the window of a person."""
    side = _SIDE * grid.reduction * _PERSON_AWAY_M
    across, down = _PERSON_M
    return (
        max(1, round(across * grid.camera.fx / side)),
        max(1, round(down * grid.camera.fy / side)),
    )


def _fills(cells: Mask, fits: tuple[int, int], share: float) -> bool:
    """True if the cells (rows, columns) fill this share of any window of so many columns, rows."""
    columns, rows = min(fits[0], cells.shape[1]), min(fits[1], cells.shape[0])
    total = np.pad(cells.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    inside = total[rows:, columns:] - total[:-rows, columns:]
    inside = inside - total[rows:, :-columns] + total[:-rows, :-columns]
    return bool(inside.max() >= share * rows * columns)


def _near(view: View, max_disparity_px: int, known: Weights) -> Mask:
    """Cells (rows, columns) that match at larger disparities than are searched.

    What is too near is matched wrongly in places, so that some of it seems known; where nearly all
    is, the larger disparity is the wrong one, as of a pattern that repeats.
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
