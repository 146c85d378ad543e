"""Survey by a short drive, recorded frame by frame, to estimate the camera's pose on the robot."""

from __future__ import annotations

import asyncio
from collections import deque

from app.contract.events import ObservationEvent
from app.contract.rig import DriveNow, RigNumber
from app.contract.values import filled
from observer.jsonl import line_pose
from observer.mount import CameraMount
from observer.rig.drive_estimate import estimate_drive
from observer.rig.drive_stretches import DriveSample
from observer.rig.estimates import Refused

# Ten minutes at 15 frames a second; a survey takes one minute.
_MOST_SAMPLES = 9000


class DriveSurvey:
    """Recorder of camera and wheel poses during a survey.

    Attributes:
        noting: whether a drive is being recorded.
    """

    def __init__(self) -> None:
        self.noting = False
        self._samples: deque[DriveSample] = deque(maxlen=_MOST_SAMPLES)

    def begin(self) -> None:
        """Discard an earlier drive and record a new one."""
        self._samples.clear()
        self.noting = True

    def end(self) -> None:
        """Stop recording; the samples remain for the estimate."""
        self.noting = False

    def observed(self, event: ObservationEvent) -> None:
        """Record one observed frame."""
        if not self.noting:
            return
        line, wheels = event.line, event.odometry
        self._samples.append(DriveSample(line["time"], line["segment"], line_pose(line), wheels))

    async def estimate(self, standing: CameraMount | None) -> DriveNow:
        """Return the estimate from the drive so far.

        Args:
            standing: tilt and roll known from elsewhere.
        """
        samples = list(self._samples)
        found = await asyncio.to_thread(estimate_drive, samples, standing)
        if isinstance(found, Refused):
            return DriveNow(self.noting, {}, [], found.sentence)
        lengths = {"forward_m": found.forward_m, "left_m": found.left_m}
        angles = {
            "pan_deg": found.pan_rad,
            "tilt_deg": found.tilt_rad,
            "roll_deg": found.roll_rad,
        }
        numbers = lengths | {key: each and each.degrees for key, each in angles.items()}
        values = {key: filled(RigNumber, each) for key, each in numbers.items() if each is not None}
        return DriveNow(self.noting, values, found.still_needed, found.sentence)
