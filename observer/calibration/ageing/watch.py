"""Watch of one calibration during a run, fed with what the observer found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from observer.calibration.ageing.row_drift import RowDrift, RowDriftWatch
from observer.calibration.ageing.scene_pairs import ScenePairs
from observer.calibration.ageing.vergence import VergenceCheck, VergenceWatch
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.types import Image, Observation, StereoFrame
from observer.vision.view import StereoRows


@dataclass(frozen=True)
class CalibrationAge:
    """State of a calibration after a frame."""

    rows: RowDrift
    vergence: VergenceCheck


class AgeingWatch:
    """Rows and vergence, and pairs for a refinement; less than 0.1 ms a frame on average.

    It belongs to one calibration: another one, or another rig, begins with a new watch.
    """

    def __init__(self, camera: StereoCamera, mount: CameraMount | None = None) -> None:
        self._rows = RowDriftWatch(camera)
        self._vergence = VergenceWatch(camera, mount)
        self._pairs = ScenePairs()

    def look(
        self, frame: StereoFrame, observation: Observation, trace: Mapping[str, Any]
    ) -> CalibrationAge:
        """Return what is known after one more frame.

        Args:
            frame: as it was played. observation: what the observer found in it.
            trace: of the same frame, of which ``rows`` is read.
        """
        rows: StereoRows | None = trace.get("rows")
        px, offset = (None, None) if rows is None else (rows.px, rows.offset_px)
        drift = self._rows.look(frame.time, px, offset)
        pose = observation.T_world_camera
        vergence = self._vergence.look(frame.time, observation.segment, rows, pose, frame.odometry)
        # Pictures in which the camera knows where it is are worth keeping.
        if pose is not None:
            self._pairs.offer(frame.time, frame.left, frame.right)
        return CalibrationAge(drift, vergence)

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """The newest pairs (H, W) grey as taken, for ``refine_from_scene``, which takes
        about a second: give them to a thread."""
        return self._pairs.pairs
