"""The simulated lab as a source of stereo frames."""

from __future__ import annotations

import math
import time as clock
from typing import Protocol

from observer.camera import StereoCalibration
from observer.simulation.imaging import StereoImager
from observer.simulation.odometry import SimulatedOdometry
from observer.simulation.world import World
from observer.sources.contract import SourceInfo
from observer.types import Image, StereoFrame

# Seconds: by then everything that moves is in view in every built-in scenario.
_STILL_S = 2.0


class DrivenVehicles(Protocol):
    """Driven vehicles of a world, stepped by its frames' clock."""

    @property
    def goes_on(self) -> bool:
        """True while a vehicle is driven, so that the source does not end at its last frame."""
        ...

    def advance(self, time: float) -> None:
        """Advance to the next frame's time, seconds, before it is drawn."""
        ...

    def restart(self) -> None:
        """Return to the start: the next frame is the first."""
        ...


class SimulatedSource:
    """Frames of a world at full speed; frame k has the time k / frame_rate.

    The frames carry images and odometry only; ``SimulatedTruth`` is the world's ground truth.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._imager = StereoImager(world)
        self._odometry = SimulatedOdometry(world)
        self._next = 0
        self._driven: DrivenVehicles | None = None

    def follow(self, driven: DrivenVehicles) -> None:
        """Show driven vehicles from the next frame on; call ``World.move`` for them first."""
        self._driven = driven
        self._imager = StereoImager(self._world)

    @property
    def info(self) -> SourceInfo:
        s = self._world.scenario
        return SourceInfo(
            spec=self._world.spec,
            kind="simulated",
            width=s.camera.width,
            height=s.camera.height,
            frame_rate=s.frame_rate,
            frame_count=s.frame_count,
            mount_height_m=s.camera.height_m,
            mount_tilt_rad=math.radians(s.camera.tilt_deg),
            mount_forward_m=s.camera.forward_m,
            mount_left_m=s.camera.baseline_m / 2,
        )

    @property
    def calibration(self) -> StereoCalibration | None:
        """The true calibration, unless the scenario hands out a wrong one or none."""
        handed_out = self._world.scenario.hands_out_calibration
        return self._world.calibration if handed_out else None

    def read(self) -> StereoFrame | None:
        """Return the next frame; None after the last one unless a vehicle is driven."""
        s = self._world.scenario
        if self._next >= s.frame_count and not (self._driven and self._driven.goes_on):
            return None
        index = self._next
        self._next += 1
        now = index / s.frame_rate
        if self._driven is not None:
            self._driven.advance(now)
        left, right = self._imager.pair(index, now)
        has_right_time = s.faults.skew_s != 0 and s.faults.skew_known
        return StereoFrame(
            index=index,
            time=now,
            left=left,
            right=right,
            received=clock.monotonic(),
            right_time=self._imager.right_time(now) if has_right_time else None,
            odometry=self._odometry.read(now),
        )

    def skip(self, count: int) -> None:
        """Skip frames without drawing them."""
        rate = self._world.scenario.frame_rate
        for index in range(self._next, self._next + count):
            if self._driven is not None:
                self._driven.advance(index / rate)
            self._odometry.read(index / rate)
        self._next += count

    def still(self) -> Image:
        """Render a left image (H, W, 3) that represents the scenario; consumes no frame."""
        s = self._world.scenario
        index = min(round(_STILL_S * s.frame_rate), s.frame_count - 1)
        return self._imager.pair(index, index / s.frame_rate)[0]

    def rewind(self) -> None:
        """Start again at the first frame."""
        self._odometry = SimulatedOdometry(self._world)
        self._next = 0
        if self._driven is not None:
            self._driven.restart()

    def close(self) -> None:
        """Release nothing."""
