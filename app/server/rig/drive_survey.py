"""A short drive, noted frame by frame, and what it says of where the camera sits on the robot."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import asdict
from typing import Any

from app.messages import ObservationEvent
from observer.jsonl import line_pose
from observer.mount import CameraMount
from observer.rig.drive_estimate import estimate_drive
from observer.rig.drive_stretches import DriveSample
from observer.rig.estimates import Refused
from observer.types import Odometry

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
        self._samples.append(
            DriveSample(
                line["time"],
                line["segment"],
                line_pose(line),
                None if wheels is None else Odometry(**wheels),
            )
        )

    async def estimate(self, standing: CameraMount | None) -> dict[str, Any]:
        """What the drive says so far.

        Args:
            standing: tilt and roll as known otherwise.

        Returns:
            ``noting``, ``values`` (by the rig's keys, each ``{"value", "sigma"}``),
            ``still_needed`` and ``sentence``.
        """
        samples = list(self._samples)
        found = await asyncio.to_thread(estimate_drive, samples, standing)
        if isinstance(found, Refused):
            return {
                "noting": self.noting,
                "values": {},
                "still_needed": [],
                "sentence": found.sentence,
            }
        lengths = {"forward_m": found.forward_m, "left_m": found.left_m}
        angles = {
            "pan_deg": found.pan_rad,
            "tilt_deg": found.tilt_rad,
            "roll_deg": found.roll_rad,
        }
        values = {key: asdict(each) for key, each in lengths.items() if each is not None}
        values |= {key: asdict(each.degrees) for key, each in angles.items() if each is not None}
        return {
            "noting": self.noting,
            "values": values,
            "still_needed": list(found.still_needed),
            "sentence": found.sentence,
        }
