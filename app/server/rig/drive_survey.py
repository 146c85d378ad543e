"""A short drive, noted frame by frame, and what it says of where the camera sits on the robot."""

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

# Ten minutes at 15 frames a second; a survey takes one.
_MOST_SAMPLES = 9000


class DriveSurvey:
    """Notes where camera and wheels were, while it is asked to.

    Attributes:
        noting: whether a drive is noted at present.
    """

    def __init__(self) -> None:
        self.noting = False
        self._samples: deque[DriveSample] = deque(maxlen=_MOST_SAMPLES)

    def begin(self) -> None:
        """Forget an earlier drive and note the one that comes."""
        self._samples.clear()
        self.noting = True

    def end(self) -> None:
        """Note no more; what was noted can still be estimated by."""
        self.noting = False

    def observed(self, event: ObservationEvent) -> None:
        """One frame was observed."""
        if not self.noting:
            return
        line, wheels = event.line, event.odometry
        self._samples.append(DriveSample(line["time"], line["segment"], line_pose(line), wheels))

    async def estimate(self, standing: CameraMount | None) -> DriveNow:
        """What the drive says so far.

        Args:
            standing: tilt and roll as known otherwise.
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
