"""Tracks that move only because static points are matched with another repetition of a pattern.

A static point that is matched at disparity d' instead of d is placed on the same line of sight, but
at d / d' of its depth. While the camera moves at V, that place moves at (1 - d / d') V: it follows
the camera. So a body that moves along with the camera may be static, at a disparity that its
velocity tells. If its points match there nearly as well, nothing shows that it moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.row_search import least_differences
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.types import TrackState
from observer.vision.sparse_stereo import FLAT, row_gradients

# m/s: a slower camera tells nothing.
_LEAST_MPS = 0.05
# Shares of the camera's velocity with which a wrong match may seem to move, and most of a velocity
# that may lead elsewhere. What is far away but matched as if it were near moves with the camera, to
# within its noise. By the formula a wrong match may also approach faster than the camera drives;
# that is never held back, for safety.
_LEAST_SHARE, _MOST_SHARE, _ELSEWHERE_SHARE = 0.1, 1.05, 0.5
_MOST_TOWARDS_SHARE = 0.95
# Cells: side of the blocks that are compared.
_SIDE = 9
# Pixels: how well the matched disparity is known; and the other one, with a share of how far they
# are apart.
_MATCHED_PX, _OTHER_PX, _OTHER_SHARE = 1.0, 2.0, 0.1
# Of a block's texture, the other match may leave so much more unexplained than the one chosen: it
# may lie between two cells where the one chosen lies on one.
_UNEXPLAINED_SHARE = 0.45
# Points that must be comparable.
_LEAST_POINTS = 2
# Gain with which their share follows the newest frame.
_GAIN = 0.25


@dataclass(frozen=True, eq=False)
class _Pair:
    """Horizontal gradients (h, w) of both reduced images, and of one without any texture."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    flat: NDArray[np.uint8]

    @staticmethod
    def of(scene: DenseScene) -> _Pair:
        left = row_gradients(scene.left)
        return _Pair(left, row_gradients(scene.right), np.full_like(left, FLAT))


@dataclass(frozen=True, eq=False)
class _Range:
    """Ranges of disparity of N points, cells: first and last (N,)."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]

    @staticmethod
    def around(px: Float64Array, reach_px: Float64Array | float, scene: DenseScene) -> _Range:
        low, high = (px - reach_px) / scene.grid.reduction, (px + reach_px) / scene.grid.reduction
        first = np.maximum(np.floor(low), 0).astype(np.int64)
        return _Range(first, np.ceil(high).astype(np.int64))

    def is_apart_from(self, other: _Range) -> NDArray[np.bool_]:
        """(N,) where neither range overlaps or adjoins the other."""
        return (other.last + 1 < self.first) | (self.last + 1 < other.first)

    def take(self, which: NDArray[np.bool_]) -> _Range:
        return _Range(self.first[which], self.last[which])


def note_wrong_matches(
    tracks: list[BodyTrack], points: TrackedPoints, scene: DenseScene, now: CameraStep
) -> None:
    """Note for each tentative track which share of its points may be matched wrongly.

    These match as well where a wrong match would explain their motion. In a single frame noise may
    make either match the better one, so the share is averaged over some.
    """
    camera_mps = -now.T_world_camera.rotate(now.rate.shift)
    pair = None
    for track in [t for t in tracks if t.state is TrackState.TENTATIVE]:
        share = _share_of(camera_mps, track.mean[VELOCITY]) if track.rigid else None
        if share is None:
            track.wrong_match = None
            continue
        pair = pair or _Pair.of(scene)
        mine = np.flatnonzero((points.obstacle == track.id) & np.isfinite(points.disparity))
        alike = _match_as_well(points.px[mine], points.disparity[mine], 1 - share, pair, scene)
        before, now_alike = track.wrong_match, _mean(alike)
        if before is None or now_alike is None:
            track.wrong_match = now_alike
        else:
            track.wrong_match = before + _GAIN * (now_alike - before)


def _mean(alike: NDArray[np.bool_]) -> float | None:
    return float(alike.mean()) if len(alike) >= _LEAST_POINTS else None


def _share_of(camera_mps: Float64Array, velocity: Float64Array) -> float | None:
    """Return a velocity (3,) as a share of the camera's, m/s; None if no wrong match has it."""
    square = float(camera_mps @ camera_mps)
    if square < _LEAST_MPS**2:
        return None
    share = float(velocity @ camera_mps) / square
    if abs(share) < _LEAST_SHARE or not -_MOST_TOWARDS_SHARE <= share <= _MOST_SHARE:
        return None
    elsewhere = np.linalg.norm(velocity - share * camera_mps)
    return share if elsewhere <= _ELSEWHERE_SHARE * np.linalg.norm(velocity) else None


def _match_as_well(
    px: NDArray[np.float32],
    disparity: Float64Array,
    ratio: float,
    pair: _Pair,
    scene: DenseScene,
) -> NDArray[np.bool_]:
    """(K,) whether each point that can be compared matches as well at another disparity.

    Args:
        px: (N, 2) pixels. disparity: (N,) px, as matched. ratio: of the other to it.
    """
    other = np.maximum(0.0, ratio * disparity)
    reach = np.maximum(_OTHER_PX, _OTHER_SHARE * np.abs(disparity - other))
    chosen = _Range.around(disparity, _MATCHED_PX, scene)
    elsewhere = _Range.around(other, reach, scene)
    distinct = chosen.is_apart_from(elsewhere)
    chosen, elsewhere = chosen.take(distinct), elsewhere.take(distinct)
    cells = np.rint(scene.grid.to_cells(px[distinct].astype(np.float64))).astype(np.int64)

    def differences(image: NDArray[np.uint8], within: _Range) -> NDArray[np.float32]:
        return least_differences(pair.left, image, cells, within.first, within.last, _SIDE)

    nowhere = _Range(np.zeros(len(cells), np.int64), np.zeros(len(cells), np.int64))
    texture = differences(pair.flat, nowhere)
    here, there = differences(pair.right, chosen), differences(pair.right, elsewhere)
    known = np.isfinite(texture) & np.isfinite(here) & np.isfinite(there)
    return np.asarray((there <= here + _UNEXPLAINED_SHARE * texture)[known])
