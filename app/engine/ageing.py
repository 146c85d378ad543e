"""How the calibration in use holds, as the engine tells it."""

from __future__ import annotations

from app.contract.status import AgeingStatus, RowDriftStatus, VergenceStatus
from app.contract.values import filled
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
        self._told: CalibrationAge | None = None
        self._facts: AgeingStatus | None = None

    def look(self, observed: Observed) -> None:
        """Note one frame."""
        self._age = self._watch.look(observed.frame, observed.observation, observed.trace)

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """Pairs of the last half minute as taken, (H, W) grey."""
        return self._watch.pairs

    def facts(self) -> AgeingStatus | None:
        """As ``StateEvent.ageing`` holds it."""
        age, told = self._age, self._told
        # Asked several times a frame, while the watch finds something new once a second.
        if age is None or (told and age.rows is told.rows and age.vergence is told.vergence):
            return self._facts
        history = [(round(t, 1), round(px, 4)) for t, px in age.rows.history]
        rows = filled(RowDriftStatus, age.rows, history=history)
        self._told, self._facts = age, AgeingStatus(rows, filled(VergenceStatus, age.vergence))
        return self._facts
