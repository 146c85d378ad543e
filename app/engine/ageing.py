"""How the calibration in use holds: rows watched, vergence tested, pairs kept for a refinement."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from app.engine.watched import Observed
from observer.calibration.ageing.row_drift import RowDrift, RowDriftWatch
from observer.calibration.ageing.scene_pairs import ScenePairs
from observer.calibration.ageing.vergence import VergenceCheck, VergenceWatch
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.types import Image


class CalibrationAgeing:
    """Fed with every observed frame of one session; takes less than 0.1 ms a frame."""

    def __init__(self, camera: StereoCamera, mount: CameraMount | None) -> None:
        self._rows = RowDriftWatch(camera)
        self._vergence = VergenceWatch(camera, mount)
        self._pairs = ScenePairs()
        self._drift: RowDrift | None = None
        self._check: VergenceCheck | None = None

    def look(self, observed: Observed) -> None:
        """Note one frame."""
        frame, observation = observed.frame, observed.observation
        rows = observed.trace.get("rows")
        offsets = (None, None) if rows is None else (rows.px, rows.offset_px)
        self._drift = self._rows.look(frame.time, *offsets)
        self._check = self._vergence.look(
            frame.time, observation.segment, rows, observation.T_world_camera, frame.odometry
        )
        self._pairs.offer(frame.time, frame.left, frame.right)

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """Pairs of the last half minute as taken, (H, W) grey."""
        return self._pairs.pairs

    def facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.ageing`` holds it."""
        if self._drift is None or self._check is None:
            return None
        drift = asdict(self._drift)
        drift["history"] = [[round(t, 1), round(px, 4)] for t, px in self._drift.history]
        return {"rows": drift, "vergence": asdict(self._check)}
