"""What a source of stereo frames is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from observer.camera import StereoCalibration
from observer.mount import CameraMount
from observer.types import StereoFrame


@dataclass(frozen=True)
class SourceInfo:
    """What a source says of itself.

    Attributes:
        spec: the text it was opened by, as in ``simulated:lab``.
        kind: ``simulated``, ``stereo folder``, ``KITTI odometry``, ``KITTI raw``, ``EuRoC``,
            ``video``; words shown to people.
        width, height: of each image, pixels.
        frame_rate: nominal, 1/s.
        frame_count: total number of frames, or None for a live source.
        live: True where frames come at their own pace and cannot be paused.
        mount_height_m: height of the left camera above the floor, None where unknown.
        mount_tilt_rad: angle by which the camera looks down from the horizontal, None where
            unknown.
        mount_forward_m, mount_left_m: of the left camera from the middle of the axle about which
            the robot turns, None where unknown.
    """

    spec: str
    kind: str
    width: int
    height: int
    frame_rate: float
    frame_count: int | None
    live: bool = False
    mount_height_m: float | None = None
    mount_tilt_rad: float | None = None
    mount_forward_m: float | None = None
    mount_left_m: float | None = None

    @property
    def mount(self) -> CameraMount | None:
        """How the left camera is mounted, where height and tilt are known."""
        if self.mount_height_m is None or self.mount_tilt_rad is None:
            return None
        return CameraMount(
            self.mount_height_m, self.mount_tilt_rad, self.mount_forward_m, self.mount_left_m
        )


@dataclass(frozen=True)
class SkippedFrame:
    """A frame that could not be read; the source goes on with the next one.

    Attributes:
        index: the number it would have had.
        reason: one sentence naming the file and what is wrong with it.
    """

    index: int
    reason: str


class Source(Protocol):
    """A sequence of stereo frames, opened by its constructor.

    Reads are made by one thread. ``received`` of every frame is the monotonic clock at read.
    """

    @property
    def info(self) -> SourceInfo: ...

    @property
    def calibration(self) -> StereoCalibration | None:
        """The calibration that came with the source; None where it brings none."""
        ...

    def read(self) -> StereoFrame | SkippedFrame | None:
        """The next frame, a frame that was skipped and why, or None after the last one."""
        ...

    def rewind(self) -> None:
        """Go back to the first frame. Live sources raise SourceError."""
        ...

    def close(self) -> None:
        """Release files and devices; safe to call twice."""
        ...
