"""Things that entered space seen to be free before, or that are seen where others stood."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Pose
from observer.kernels.free_space import ARRIVED, STATIC, UNCOVERED, UNKNOWN, evidence_against
from observer.methods.rigid.dense.corrections import with_bias
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.reprojection import reprojection

__all__ = ["ARRIVED", "STATIC", "UNCOVERED", "UNKNOWN", "DepthFrame", "FreeSpace", "slack_px"]

# Seconds back to the frames that are compared, oldest first: the oldest that saw a place decides.
_LAGS_S = (3.2, 1.6, 0.8, 0.4, 0.2)
# A frame may stand for a lag from which its age differs by no more than this share.
_LAG_SLACK = 0.35
# Least difference of disparity that is no noise: matched columns, plus a share of the disparity.
_LEAST_COLUMNS, _LEAST_SHARE = np.float32(0.6), np.float32(0.03)
# Cells, sides of the neighbourhoods whose nearest and farthest cell count: edges in depth are not
# sharp.
_NEAREST_CELLS, _FARTHEST_CELLS = 5, 3
_NOTHING, _FARTHER = np.float32(-1), np.float32(1e4)


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """Depth of one frame.

    Attributes:
        time: seconds. disparity: (h, w) px, NaN unknown. T_camera_world: the pose.
    """

    time: float
    disparity: NDArray[np.float32]
    T_camera_world: Pose

    @cached_property
    def nearest(self) -> NDArray[np.float32]:
        """(h, w) px, largest around each cell; -1 where nothing is known."""
        around = np.ones((_NEAREST_CELLS, _NEAREST_CELLS), np.uint8)
        return np.asarray(cv2.dilate(np.fmax(self.disparity, _NOTHING), around), np.float32)

    @cached_property
    def farthest(self) -> NDArray[np.float32]:
        """(h, w) px, least around each cell; very large where nothing is known."""
        around = np.ones((_FARTHEST_CELLS, _FARTHEST_CELLS), np.uint8)
        return np.asarray(cv2.erode(np.fmin(self.disparity, _FARTHER), around), np.float32)


class FreeSpace:
    """Remembers the depth of some seconds, and tests a frame against it."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._frames: deque[DepthFrame] = deque()

    def keep(self, frame: DepthFrame) -> None:
        """Remember a frame; forget those older than any lag."""
        self._frames.append(frame)
        oldest = frame.time - _LAGS_S[0] * (1 + _LAG_SLACK)
        while self._frames[0].time < oldest:
            self._frames.popleft()

    def correct_disparities(self, bias_px: float) -> None:
        """Change the frames as if their disparities had been larger by a bias, px."""
        self._frames = deque(
            replace(frame, disparity=with_bias(frame.disparity, bias_px, self._grid))
            for frame in self._frames
        )

    def evidence(self, frame: DepthFrame, cells: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """(h, w) evidence of motion of the cells (h, w); ``UNKNOWN`` for all others.

        A cell nearer than all that was seen along its ray before has *arrived* in free space. One
        farther than all was *uncovered* by what has left. What was there before is *static*.
        """
        out = np.full(frame.disparity.size, UNKNOWN, np.uint8)
        asked = np.flatnonzero(cells)
        T_world_camera = frame.T_camera_world.inverse()
        for reference in self._references(frame.time):
            if len(asked) == 0:
                break
            out[asked], asked = evidence_against(
                asked,
                frame.disparity.ravel(),
                *reprojection(self._grid, reference.T_camera_world @ T_world_camera),
                reference.disparity.ravel(),
                reference.nearest.ravel(),
                reference.farthest.ravel(),
                *slack_px(self._grid),
            )
        return out.reshape(frame.disparity.shape)

    def _references(self, time: float) -> list[DepthFrame]:
        """List the frames to compare with, oldest first."""
        chosen: list[DepthFrame] = []
        ages = time - np.array([frame.time for frame in self._frames])
        for lag in _LAGS_S if self._frames else ():
            off = np.abs(ages - lag)
            nearest = self._frames[int(off.argmin())]
            if nearest not in chosen and off.min() <= _LAG_SLACK * lag:
                chosen.append(nearest)
        return chosen


def slack_px(grid: Grid) -> tuple[np.float32, np.float32]:
    """Return pixels, and a share of the disparity, up to which equal disparities may differ."""
    return np.float32(_LEAST_COLUMNS * grid.column_px), _LEAST_SHARE
