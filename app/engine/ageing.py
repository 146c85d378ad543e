"""How the calibration in use holds, as the engine tells it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from app.engine.watched import Observed
from observer.calibration.ageing.watch import AgeingWatch, CalibrationAge
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.types import Image


class CalibrationAgeing:
    """Fed with every observed frame of one session; takes less than 0.1 ms a frame."""

    def __init__(self, camera: StereoCamera, mount: CameraMount | None) -> None:
        self._watch = AgeingWatch(camera, mount)
        self._age: CalibrationAge | None = None

    def look(self, observed: Observed) -> None:
        """Note one frame."""
        self._age = self._watch.look(observed.frame, observed.observation, observed.trace)

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """Pairs of the last half minute as taken, (H, W) grey."""
        return self._watch.pairs

    def facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.ageing`` holds it."""
        if self._age is None:
            return None
        rows = asdict(self._age.rows)
        rows["history"] = [[round(t, 1), round(px, 4)] for t, px in self._age.rows.history]
        return {"rows": rows, "vergence": asdict(self._age.vergence)}
