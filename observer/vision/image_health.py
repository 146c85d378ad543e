"""Health of the images over time: every fault of a pair as one sentence."""

from __future__ import annotations

import math
from collections import deque

import cv2
import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.parameters import StereoParameters
from observer.vision.epipolar_error import epipolar_error, epipolar_reason
from observer.vision.flicker import FLICKER_WINDOW_S, flicker_reason
from observer.vision.image_checks import exposure_reason, frozen_reason
from observer.vision.mismatch import mismatch_reason
from observer.vision.swapped import says_swapped
from observer.vision.view import StereoRows, View

# A single repeated pair may be a repeated frame of a video.
_FROZEN_FRAMES = 2
# Frames between two checks of the rows: they drift slowly; the result is kept until the next check.
_ROWS_EVERY = 5
# Share of the features that must be matched for their brightness to represent both cameras.
_MOSTLY_MATCHED = 0.6
# Below this share of features with depth, or with fewer matches, the cause is looked for, and again
# every so many frames while it lasts.
_POOR_STEREO, _FEW_MATCHES = 0.35, 40
_ASK_EVERY = 10


class ImageHealth:
    """Returns one sentence for each fault of a frame's images."""

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        self._previous: View | None = None
        self._frozen = 0
        self._frames = 0
        self._rows: str | None = None
        self._mismatch: str | None = None
        self._doubtful_frames = 0
        self._asked = False
        self._light: deque[tuple[float, float]] = deque()

    def look(
        self,
        view: View,
        parameters: StereoParameters,
        stereo_share: float | None = None,
        rows: StereoRows | None = None,
    ) -> tuple[str, ...]:
        """Return what is wrong with this view.

        Args:
            stereo_share: share of its features whose depth is known; None if the method has not
                matched it, as for the first view of a segment.
            rows: its stereo matches, if there are any.
        """
        exposure = exposure_reason(view.left, view.right)
        if exposure is not None:
            # The scene itself may look unequally bright to the two cameras; matches show that.
            exposure = exposure_reason(view.left, view.right, _matched(rows, stereo_share))
        frozen = self._look_frozen(view)
        flicker = self._look_at_light(view)
        if exposure is None and stereo_share is not None:
            self._look_at_stereo(view, parameters, stereo_share, rows)
        self._frames += 1
        reasons = (exposure, frozen, flicker, self._mismatch, self._rows)
        return tuple(r for r in reasons if r is not None)

    def _look_at_light(self, view: View) -> str | None:
        if self._light and view.time < self._light[-1][0]:
            # Time went backwards: the earlier levels are not from the last second.
            self._light.clear()
        self._light.append((view.time, math.log1p(cv2.mean(view.left)[0])))
        while view.time - self._light[0][0] > FLICKER_WINDOW_S:
            self._light.popleft()
        return flicker_reason([level for _, level in self._light])

    def _look_frozen(self, view: View) -> str | None:
        previous, self._previous = self._previous, view
        reason = None
        if previous is not None:
            reason = frozen_reason(previous.left, previous.right, view.left, view.right)
        self._frozen = 0 if reason is None else self._frozen + 1
        return reason if self._frozen >= _FROZEN_FRAMES else None

    def _look_at_stereo(
        self,
        view: View,
        parameters: StereoParameters,
        stereo_share: float,
        rows: StereoRows | None,
    ) -> None:
        poor = stereo_share < _POOR_STEREO or (rows is not None and len(rows.px) < _FEW_MATCHES)
        # A swapped pair may match by chance, even well: the first pair is always tested, and a
        # finding stays until a later test contradicts it.
        if poor or says_swapped(self._mismatch) or not self._asked:
            self._asked = True
            if self._doubtful_frames % _ASK_EVERY == 0:
                found = mismatch_reason(view.left, view.right, parameters.max_disparity_px)
                self._mismatch = found if poor or says_swapped(found) else None
            self._doubtful_frames += 1
        else:
            self._mismatch, self._doubtful_frames = None, 0
        if rows is not None and self._frames % _ROWS_EVERY == 0:
            error = epipolar_error(rows.px, rows.offset_px, self._camera)
            self._rows = None if error is None else epipolar_reason(error)


def _matched(
    rows: StereoRows | None, stereo_share: float | None
) -> tuple[Float64Array, Float64Array] | None:
    """Return pixels (N, 2) of the same points in both images; None if too few are matched."""
    if rows is None or stereo_share is None or stereo_share < _MOSTLY_MATCHED:
        return None
    known = np.isfinite(rows.disparity)
    if np.count_nonzero(known) < _FEW_MATCHES:
        return None
    px = rows.px[known]
    return px, px - np.stack([rows.disparity[known], rows.offset_px[known]], axis=1)
