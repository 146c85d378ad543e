"""Ageing of the calibration in use, as the engine reports it."""

from __future__ import annotations

from app.contract.status import AgeingStatus, ExposureSkewStatus, RowDriftStatus, VergenceStatus
from app.contract.values import filled, known
from app.engine.observed import Observed
from app.engine.tolerated import Tolerated
from observer.calibration.ageing.vergence import VergenceCheck
from observer.calibration.ageing.watch import AgeingWatch, CalibrationAge
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.types import Image


class CalibrationAgeing:
    """Ageing watch fed with every observed frame of one session; takes under 0.1 ms a frame."""

    def __init__(self, camera: StereoCamera, mount: CameraMount | None) -> None:
        self._watch = AgeingWatch(camera, mount)
        self._age: CalibrationAge | None = None
        self._reported: CalibrationAge | None = None
        self._facts: AgeingStatus | None = None
        self._tolerated = Tolerated()

    def add_frame(self, observed: Observed) -> None:
        """Process one frame; a failure is only reported."""
        with self._tolerated.work("checking the calibration's age"):
            self._age = self._watch.add_frame(observed.frame, observed.observation, observed.trace)

    @property
    def troubles(self) -> tuple[str, ...]:
        """Return why the age is not checked, one sentence each."""
        return self._tolerated.troubles

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """Return the raw pairs of the last half minute, (H, W) grey."""
        return self._watch.pairs

    @property
    def vergence(self) -> VergenceCheck | None:
        """Return what is known of the vergence; None before the first frame."""
        return None if self._age is None else self._age.vergence

    def facts(self) -> AgeingStatus | None:
        """Return the facts as ``StateEvent.ageing`` holds them."""
        age = self._age
        # Called several times a frame, while the watch has news only once a second.
        if age is None or (self._reported is not None and _same(age, self._reported)):
            return self._facts
        history = [(round(t, 1), round(px, 4)) for t, px in age.rows.history]
        rows = filled(RowDriftStatus, age.rows, history=history)
        vergence = filled(VergenceStatus, age.vergence)
        skew = known(ExposureSkewStatus, age.exposure_skew)
        self._reported, self._facts = age, AgeingStatus(rows, vergence, skew)
        return self._facts


def _same(age: CalibrationAge, reported: CalibrationAge) -> bool:
    return (
        age.rows is reported.rows
        and age.vergence is reported.vergence
        and age.exposure_skew is reported.exposure_skew
    )
