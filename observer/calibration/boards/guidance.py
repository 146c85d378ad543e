"""Guidance on where to hold the board next: the most useful pose, as outline and in words.

The lenses are not known yet, so a typical webcam's pinhole model stands in for them. Outlines drawn
with it have about the right perspective; what counts in the end is measured in the images.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.coverage import (
    NEW_DISTANCE,
    WANTED_RANGES,
    ViewMeasures,
    coverage,
    measure_outline,
    progress,
    stacked,
)
from observer.geometry import Float64Array

# Focal length over the image's width: 64 degrees across, between laptops and wide webcams.
_FOCAL_WIDTHS = 0.8
# sqrt(area of the board / area of the image) of wanted poses.
_SIZES = (0.16, 0.22, 0.3, 0.38, 0.46, 0.56)
# Share of the largest size that both cameras could see whole, as a hand misses the outline.
_SIZE_SHARE = 0.9
# Steep enough that skew's bar fills even if the board is held 5 degrees less steep.
_TILT_RAD = np.deg2rad(45.0)
# White margin that detection needs, and a hand's inaccuracy, in squares.
_MARGIN_SQUARES = 0.8
# Weights against filling a bar from 0 to 1: a tilt not shown before (more than this angle from all
# others); reaching an image corner, and completing a bar or corner.
_NEW_TILT_WEIGHT, _NEW_TILT_RAD = 0.15, np.deg2rad(20.0)
_REACH_WEIGHT, _FILLED_WEIGHT = 0.5, 0.3
# Weights of the distance from all views, and against the distance from the last one.
_FAR_WEIGHT, _WAY_WEIGHT = 0.2, 0.03
# More than the least distance of new views, as a hand misses the outline.
_CLEARLY_NEW = NEW_DISTANCE + 0.08
# The first pose: in the middle of the image, of medium size, facing the cameras.
_FIRST = (0.5, 0.5, 0.42, 0.0)
# Where the right camera is assumed to see the board until both did: shift as a share of the image
# width, constant and over depth in board widths, and its standard deviations.
_SHIFT = np.array([0.0, -0.15])
_SHIFT_STD = np.array([0.05, 0.2])
# Larger differences are put in words: of places, over the image's size; of sizes; of tilts.
_PLACE_TOLERANCE, _SIZE_TOLERANCE, _TILT_TOLERANCE_RAD = 0.07, 1.15, np.deg2rad(15.0)
# Depth in board widths, and mean shift (du, dv) of the corners from the left image to the right
# one, pixels.
Shift = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class SeenPose:
    """Pose of a board, by the camera model that stands in for the real one.

    Attributes:
        centre_px: (2,) the board's centre in the image.
        depth: of its centre, in board widths.
        normal: (3,) unit, camera frame, out of the board's back: (0, 0, 1) if it faces the camera.
    """

    centre_px: Float64Array
    depth: float
    normal: Float64Array


@dataclass(frozen=True, eq=False)
class WantedPose:
    """A pose of the board that would add to the views.

    Attributes:
        number: its number among the guide's poses.
        outline: (4, 2) pixels of the left image: the squares' outer edge, by the board's upper
            left, upper right, lower right and lower left.
        pose: the same in numbers.
        measures: what it would add.
    """

    number: int
    outline: Float64Array
    pose: SeenPose
    measures: ViewMeasures


class Guide:
    """Chooses poses for one board and one size of image.

    Args:
        image_size: width and height of each camera's image, pixels.
    """

    def __init__(self, board: Board, image_size: tuple[int, int]) -> None:
        self._board = board
        self._size = np.array(image_size, dtype=np.float64)
        self._image_size = image_size
        self._focal = _FOCAL_WIDTHS * image_size[0]
        self._middle = (self._size - 1) / 2
        # Board units are its inner width.
        self._unit = (board.columns - 1) * board.square_m
        self._poses = _poses(board, self._focal, image_size)
        self._latest: tuple[tuple[Shift, ...], list[WantedPose]] | None = None

    def seen(self, sighting: BoardSighting) -> SeenPose | None:
        """Return the pose of a board by its corners, or None where they do not determine it."""
        points = self._board.object_points[sighting.ids] / self._unit
        camera = np.array(
            [[self._focal, 0, self._middle[0]], [0, self._focal, self._middle[1]], [0, 0, 1]]
        )
        try:
            found, turn, t = cv2.solvePnP(
                points, sighting.px, camera, None, flags=cv2.SOLVEPNP_IPPE
            )
        except cv2.error:  # corners in one line have no pose
            return None
        if not found:
            return None
        rotation = cv2.Rodrigues(turn)[0]
        centre = rotation @ (self._board.object_points.mean(axis=0) / self._unit) + t.ravel()
        if centre[2] <= 0:
            return None
        place = self._middle + self._focal * centre[:2] / centre[2]
        return SeenPose(place, float(centre[2]), np.asarray(rotation[:, 2], dtype=np.float64))

    def wanted_ranges(self, shifts: Sequence[Shift] = ()) -> tuple[float, ...]:
        """Return the measures' ranges that fill the bars: the usual ones, but no unreachable size.

        Two cameras far apart do not both see a whole board from close by.
        """
        sizes = [pose.measures.values[:, 2].min() for pose in self._candidates(shifts)]
        x, y, size, skew = WANTED_RANGES
        return x, y, min(size, _SIZE_SHARE * max(sizes, default=size)), skew

    def next_pose(
        self,
        kept: Sequence[ViewMeasures],
        poses: Sequence[SeenPose],
        shifts: Sequence[Shift] = (),
        skipped: Collection[int] = (),
    ) -> WantedPose | None:
        """Return the pose that adds most to the kept views; None if they cover everything.

        Args:
            kept: measures of the views.
            poses: of the views, as the left camera saw them.
            shifts: wherever both cameras saw the board.
            skipped: numbers of poses that were tried in vain.
        """
        wanted = self.wanted_ranges(shifts)
        now = coverage(kept, wanted)
        if now.enough and min(now.reached.values()) >= 1:
            return None
        candidates = [c for c in self._candidates(shifts) if c.number not in skipped]
        if not kept:
            facing = [c for c in candidates if c.pose.normal[2] > 0.99]
            off = [np.abs(c.measures.values[0] - _FIRST).sum() for c in facing]
            return facing[int(np.argmin(off))] if facing else None
        values, reach = stacked([c.measures for c in candidates])
        kept_values, kept_reach = stacked(kept)
        way = np.abs(values[:, None] - kept_values).sum(axis=-1).mean(axis=-1)
        before = progress(
            kept_values.min(axis=0), kept_values.max(axis=0), kept_reach.max(axis=0), wanted
        )
        after = progress(
            np.minimum(values, kept_values.min(axis=0)),
            np.maximum(values, kept_values.max(axis=0)),
            np.maximum(reach, kept_reach.max(axis=0)),
            wanted,
        )
        worth = (after[0] - before[0]).sum(axis=1)
        worth += _REACH_WEIGHT * (after[1] - before[1]).sum(axis=1)
        for then, now_full in zip(after, before, strict=True):
            worth += _FILLED_WEIGHT * ((then >= 1) & (now_full < 1)).sum(axis=1)
        worth += _FAR_WEIGHT * way.min(axis=1) - _WAY_WEIGHT * way[:, -1]
        if poses:
            normals = np.array([c.pose.normal for c in candidates])
            cosines = normals.reshape(-1, 3) @ np.array([pose.normal for pose in poses]).T
            worth += _NEW_TILT_WEIGHT * (cosines.max(axis=1) < np.cos(_NEW_TILT_RAD))
        worth[way.min(axis=1) < _CLEARLY_NEW] = -np.inf
        best = int(np.argmax(worth)) if len(worth) else -1
        return candidates[best] if best >= 0 and np.isfinite(worth[best]) else None

    def words(self, wanted: WantedPose, now: SeenPose | None) -> str:
        """Return how to move the board there from where it is; left and right as in the image."""
        target = wanted.pose
        place = _place((target.centre_px - self._middle) / self._size)
        tilt = _tilt(target.normal)
        if now is None:
            parts = [f"Hold the board in the {place} of the image", *([tilt] if tilt else [])]
            return ", ".join(parts)
        away = (target.centre_px - now.centre_px) / self._size
        parts = []
        if (np.abs(away) > _PLACE_TOLERANCE).any():
            parts.append(f"move it to the {place} of the image")
        nearer = now.depth / target.depth
        if nearer > _SIZE_TOLERANCE or nearer < 1 / _SIZE_TOLERANCE:
            word = "closer" if nearer > 1 else "further away"
            parts.append(f"and {word}" if parts else f"move it {word}")
        moves = [" ".join(parts)] if parts else []
        if np.arccos(np.clip(now.normal @ target.normal, -1, 1)) > _TILT_TOLERANCE_RAD:
            moves.append(tilt or "turn it to face the cameras")
        sentence = "; ".join(moves) or "hold it there"
        return sentence[0].upper() + sentence[1:]

    def _candidates(self, shifts: Sequence[Shift]) -> list[WantedPose]:
        if self._latest is None or self._latest[0] != tuple(shifts):
            self._latest = tuple(shifts), self._fitting(shifts)
        return self._latest[1]

    def _fitting(self, shifts: Sequence[Shift]) -> list[WantedPose]:
        """Return the poses that both cameras would see whole, moved into the images if needed."""
        constant, by_depth, down = self._shift(shifts)
        rotations, centres = self._poses[0], self._poses[1].copy()
        board = self._board
        step = 1 / (board.columns - 1)
        half = np.array([1.0, (board.rows - 1) * step]) / 2
        edge = half + step * (1 + _MARGIN_SQUARES)
        corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
        grid = np.array([[u, v] for v in (-1, 0, 1) for u in (-1, 0, 1)], dtype=np.float64)
        flat = np.concatenate([corner * edge, corner * (half + step), corner * half, grid * half])
        rays = np.einsum("mij,nj->mni", rotations[:, :, :2], flat)
        for _ in range(4):
            points = rays + centres[:, None]
            left = self._middle + self._focal * points[..., :2] / points[..., 2:]
            right = left + np.stack(
                [constant + by_depth / points[..., 2], np.full(points.shape[:2], down)], axis=-1
            )
            both = np.concatenate([left[:, :4], right[:, :4]], axis=1)
            under = np.maximum(-both.min(axis=1), 0)
            over = np.maximum(both.max(axis=1) - (self._size - 1), 0)
            fits = ((under < 2) & (over < 2)).all(axis=1)
            centres[:, :2] += (under - over) * centres[:, 2:] / self._focal
        measured = measure_outline(left[:, 8:12], left[:, 12:], self._image_size).beside(
            measure_outline(right[:, 8:12], right[:, 12:], self._image_size)
        )
        return [
            WantedPose(
                k,
                left[k, 4:8],
                SeenPose(
                    self._middle + self._focal * points[k, 16, :2] / points[k, 16, 2],
                    float(points[k, 16, 2]),
                    rotations[k, :, 2],
                ),
                ViewMeasures(measured.values[k], measured.reach[k]),
            )
            for k in np.flatnonzero(fits & (points[..., 2].min(axis=1) > 0)).tolist()
        ]

    def _shift(self, shifts: Sequence[Shift]) -> tuple[float, float, float]:
        """Shift from left to right image: constant and over depth along x, constant along y.

        Combines what was seen so far with the usual values, weighted by their certainty.
        """
        width = self._size[0]
        usual, std = _SHIFT * width, _SHIFT_STD * width
        if not shifts:
            return float(usual[0]), float(usual[1]), 0.0
        depth, du, dv = np.array(shifts, dtype=np.float64).T
        std_seen = 0.01 * width
        terms = np.stack([np.ones_like(depth), 1 / depth], axis=1)
        weights = terms.T @ terms / std_seen**2 + np.diag(1 / std**2)
        constant, by_depth = np.linalg.solve(weights, terms.T @ du / std_seen**2 + usual / std**2)
        return float(constant), float(by_depth), float(np.median(dv))


def _poses(
    board: Board, focal: float, image_size: tuple[int, int]
) -> tuple[Float64Array, Float64Array]:
    """Rotations (M, 3, 3) and centres (M, 3) in board widths: places x sizes x tilts."""
    inner = (board.rows - 1) / (board.columns - 1)
    width, height = image_size
    rotations, centres = [], []
    axes = [(0, 0), *((np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4)]
    for axis in axes:
        tilted = axis != (0, 0)
        turn = cv2.Rodrigues(_TILT_RAD * np.array([*axis, 0.0]))[0]
        for size in _SIZES:
            shown = size * np.sqrt(width * height)
            depth = focal * np.sqrt(inner * (np.cos(_TILT_RAD) if tilted else 1.0)) / shown
            for v in (-0.5, 0.0, 0.5):
                for u in (-0.5, 0.0, 0.5):
                    rotations.append(turn)
                    centres.append([u * width * depth / focal, v * height * depth / focal, depth])
    return np.array(rotations, dtype=np.float64), np.array(centres, dtype=np.float64)


def _place(offset: Float64Array) -> str:
    """Return the name of an offset from the image's centre over its size."""
    column = "left" if offset[0] < -0.1 else "right" if offset[0] > 0.1 else ""
    row = "upper" if offset[1] < -0.1 else "lower" if offset[1] > 0.1 else ""
    if row and not column:
        return {"upper": "top", "lower": "bottom"}[row]
    return " ".join(word for word in (row, column) if word) or "middle"


def _tilt(normal: Float64Array) -> str:
    """Return which side of the board to tilt away, or nothing where it faces the camera."""
    if np.arccos(np.clip(normal[2], -1, 1)) < _TILT_TOLERANCE_RAD:
        return ""
    # The side opposite to the direction in which the board's back points.
    side = _place(-normal[:2])
    return f"tilt its {side} {'corner' if ' ' in side else 'side'} away from the cameras"
