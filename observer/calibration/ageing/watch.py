"""Watch of one calibration during a run, fed with what the observer found."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from observer.calibration.ageing.driving_errors import (
    PointsVergence,
    SkewCheck,
    SkewWatch,
    joined_vergence,
)
from observer.calibration.ageing.row_drift import RowDrift, RowDriftWatch
from observer.calibration.ageing.vergence import VergenceCheck, VergenceWatch
from observer.camera import StereoCamera, as_gray
from observer.mount import CameraMount
from observer.trace import TraceValues
from observer.types import Image, Observation, StereoFrame
from observer.vision.view import StereoRows

# So many pairs, so many seconds apart: enough to average out a single scene's effect on the rows,
# and recent enough to show the cameras in their current state.
_PAIRS = 8
_SPACING_S = 3.0


@dataclass(frozen=True)
class CalibrationAge:
    """State of a calibration after a frame.

    Attributes:
        vergence: by the wheels or by near against far points, whichever is more precise.
        exposure_skew: of free-running cameras, unreported by the source; None until one is sure.
    """

    rows: RowDrift
    vergence: VergenceCheck
    exposure_skew: SkewCheck | None


class ScenePairs:
    """Keeps grey copies of the newest pairs; 8 of 640x480 are 5 MB."""

    def __init__(self, count: int = _PAIRS, spacing_s: float = _SPACING_S) -> None:
        self._kept: deque[tuple[float, Image, Image]] = deque(maxlen=count)
        self._spacing_s = spacing_s

    def offer(self, time_s: float, left: Image, right: Image) -> None:
        """Take a frame as taken, not rectified; it is kept if the last kept one is old enough.

        Args:
            time_s: seconds on the source's clock. left, right: (H, W) grey or (H, W, 3) BGR.
        """
        if self._kept and abs(time_s - self._kept[-1][0]) < self._spacing_s:
            return
        if self._kept and self._kept[-1][1].shape != left.shape[:2]:
            self._kept.clear()
        # A source may write the next frame into the same memory.
        self._kept.append((time_s, np.array(as_gray(left)), np.array(as_gray(right))))

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """The kept pairs (H, W) grey, oldest first."""
        return tuple((left, right) for _, left, right in self._kept)


class AgeingWatch:
    """Watch of rows, vergence and skew, with pairs for a refinement; under 0.1 ms a frame.

    It belongs to one calibration: another calibration, or another rig, needs a new watch.
    """

    def __init__(self, camera: StereoCamera, mount: CameraMount | None = None) -> None:
        self._rows = RowDriftWatch(camera)
        self._vergence = VergenceWatch(camera, mount)
        self._points = PointsVergence(camera)
        self._skew = SkewWatch()
        self._joined: tuple[VergenceCheck, VergenceCheck | None, VergenceCheck] | None = None
        self._pairs = ScenePairs()

    def add_frame(
        self, frame: StereoFrame, observation: Observation, trace: TraceValues
    ) -> CalibrationAge:
        """Return what is known after one more frame.

        Args:
            frame: as it was played. observation: what the observer found in it.
            trace: of the same frame, of which ``rows``, ``disparity_bias`` and ``exposure_skew``
                are read.
        """
        rows: StereoRows | None = trace.get("rows")
        px, offset = (None, None) if rows is None else (rows.px, rows.offset_px)
        drift = self._rows.add_frame(frame.time, px, offset)
        pose = observation.T_world_camera
        wheels = self._vergence.add_frame(
            frame.time, observation.segment, rows, pose, frame.odometry
        )
        vergence = self._join(wheels, self._points.update(trace.get("disparity_bias")))
        skew = self._skew.update(trace.get("exposure_skew"))
        # Images are worth keeping if the camera's pose is known in them.
        if pose is not None:
            self._pairs.offer(frame.time, frame.left, frame.right)
        return CalibrationAge(drift, vergence, skew)

    def _join(self, wheels: VergenceCheck, points: VergenceCheck | None) -> VergenceCheck:
        """Return the better check; the same object while neither changed, as in most frames."""
        joined = self._joined
        if joined is None or joined[0] is not wheels or joined[1] is not points:
            joined = self._joined = (wheels, points, joined_vergence(wheels, points))
        return joined[2]

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """The newest pairs (H, W) grey as taken, for ``refine_from_scene``, which takes
        about a second: give them to a thread."""
        return self._pairs.pairs
