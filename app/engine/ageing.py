"""Ageing of the calibration in use, as the engine reports it."""

from __future__ import annotations

from app.contract.status import AgeingStatus, RowDriftStatus, VergenceStatus
from app.contract.values import filled
from app.engine.observed import Observed
from observer.calibration.ageing.watch import AgeingWatch, CalibrationAge
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.types import Image


class CalibrationAgeing:
    """Ageing watch fed with every observed frame of one session; takes under 0.1 ms a frame."""

    def __init__(self, camera: StereoCamera, mount: CameraMount | None) -> None:
        self._watch = AgeingWatch(camera, mount)
        self._age: CalibrationAge | None = None
        self._told: CalibrationAge | None = None
        self._facts: AgeingStatus | None = None

    def look(self, observed: Observed) -> None:
        """Process one frame."""
        self._age = self._watch.look(observed.frame, observed.observation, observed.trace)

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """Return the raw pairs of the last half minute, (H, W) grey."""
        return self._watch.pairs

    def facts(self) -> AgeingStatus | None:
        """Return the facts as ``StateEvent.ageing`` holds them."""
        age, told = self._age, self._told
        # Called several times a frame, while the watch has news only once a second.
        if age is None or (told and age.rows is told.rows and age.vergence is told.vergence):
            return self._facts
        history = [(round(t, 1), round(px, 4)) for t, px in age.rows.history]
        rows = filled(RowDriftStatus, age.rows, history=history)
        self._told, self._facts = age, AgeingStatus(rows, filled(VergenceStatus, age.vergence))
        return self._facts
