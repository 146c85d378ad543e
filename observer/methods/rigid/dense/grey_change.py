"""Cells that look different from a moment ago, beyond the camera's own motion."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.grey_change import BLACK, differs, seen_again
from observer.methods.rigid.dense.free_space import DepthFrame, slack_px
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.reprojection import reprojection
from observer.robust import MAD_TO_SIGMA, median
from observer.types import Image

# Seconds back to the frame that is compared, and by how many that may differ: long enough for an
# arm to move by its own width, short enough for the camera to move little.
_LAG_S, _LAG_SLACK_S = 0.13, 0.07
# Least difference that is no noise: standard deviations, and grey values.
_SIGMAS, _LEAST_GREY = 4.0, 4.0
_LEAST_CELLS = 100
# Light flickers, as under leaves, if a quarter of what is seen again looks brighter or darker, by
# this share, than everything around it was a moment ago. Texture and noise stay within that.
_FLICKER_SHARE = 0.005
# The exposure swings if all of the image is brighter or darker than a moment ago by this factor.
_SWING = 1.25
# Both come in gusts: gains for a frame that changes more than those before, and for one that
# changes less.
_GUST_GAINS = (0.5, 0.03)


@dataclass(frozen=True)
class Light:
    """Change of light or exposure.

    Attributes:
        flickers: differently in different places, as under leaves, which no exposure explains.
        swings: fast, for the whole image.
    """

    flickers: bool = False
    swings: bool = False


@dataclass(frozen=True, eq=False)
class _Look:
    """One frame, and the darkest and brightest grey around each of its cells, (h, w)."""

    frame: DepthFrame
    grey: Image
    darkest: Image
    brightest: Image


class GreyChange:
    """Compares each frame's grey values with those of a moment ago."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._looks: deque[_Look] = deque()
        self._flicker: float | None = None
        self._swing = 0.0

    @property
    def light(self) -> Light:
        """Return how the light changed in the newest frames."""
        flickers = self._flicker is not None and self._flicker > _FLICKER_SHARE
        return Light(flickers=flickers, swings=self._swing > math.log(_SWING))

    def changed(
        self, frame: DepthFrame, grey: Image, cells: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """(h, w) which of the cells (h, w) show what was not seen around there a moment ago.

        What was hidden then cannot be compared; a change of exposure is allowed for. The frame is
        remembered.

        Args:
            grey: (h, w) the left image.
        """
        around = np.ones((3, 3), np.uint8)
        darkest = np.asarray(cv2.erode(grey, around), np.uint8)
        brightest = np.asarray(cv2.dilate(grey, around), np.uint8)
        out = np.zeros(frame.disparity.size, np.bool_)
        earlier = self._earlier(frame.time)
        if earlier is not None:
            out[self._against(frame, grey, earlier, np.flatnonzero(cells))] = True
        self._looks.append(_Look(frame, grey, darkest, brightest))
        return out.reshape(frame.disparity.shape)

    def _earlier(self, time: float) -> _Look | None:
        while self._looks and self._looks[0].frame.time < time - _LAG_S - _LAG_SLACK_S:
            self._looks.popleft()
        nearest = min(self._looks, key=lambda x: abs(time - x.frame.time - _LAG_S), default=None)
        if nearest is None or time - nearest.frame.time < _LAG_S - _LAG_SLACK_S:
            return None
        return nearest

    def _against(
        self, frame: DepthFrame, grey: Image, before: _Look, asked: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Return which of the cells (N,), by index, look different from an earlier frame."""
        T = before.frame.T_camera_world @ frame.T_camera_world.inverse()
        now, then, alike = seen_again(
            asked,
            frame.disparity.ravel(),
            *reprojection(self._grid, T),
            before.frame.nearest.ravel(),
            *slack_px(self._grid),
        )
        if np.count_nonzero(alike) < _LEAST_CELLS:
            return now[:0]
        # Only what is at its old depth tells of the light: somebody who enters the view does not.
        here = grey.ravel()[now[alike]].astype(np.float32)
        there, darkest, brightest = (
            look.ravel()[then[alike]].astype(np.float32)
            for look in (before.grey, before.darkest, before.brightest)
        )
        gain = np.float32(median(np.maximum(here, 1) / np.maximum(there, 1)))
        usual = gain * there
        difference = np.abs(here - usual)
        self._swing = _gusts(self._swing, abs(math.log(gain)))
        beyond = np.maximum(gain * darkest - here, here - gain * brightest)
        self._note_flicker(np.maximum(beyond, 0) / np.maximum(usual, np.float32(BLACK)))
        limit = max(_SIGMAS * MAD_TO_SIGMA * median(difference), _LEAST_GREY)
        looks = (grey.ravel(), before.darkest.ravel(), before.brightest.ravel())
        changed: NDArray[np.intp] = now[differs(now, then, *looks, gain, np.float32(limit))]
        return changed

    def _note_flicker(self, share: NDArray[np.float32]) -> None:
        """Note the share (N,) by which each cell is brighter or darker than all around it was."""
        now = float(np.quantile(share, 0.75))
        self._flicker = now if self._flicker is None else _gusts(self._flicker, now)


def _gusts(before: float, now: float) -> float:
    """Return how much the light changes of late, updated by the newest frame's change."""
    more, less = _GUST_GAINS
    return before + (more if now > before else less) * (now - before)
