"""Contract of a source of stereo frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from observer.camera import StereoCalibration
from observer.mount import CameraMount
from observer.types import StereoFrame

# The engine's loop reads the source between its heartbeats, so no read may take longer.
LIVE_PATIENCE_S = 0.03
# Kinds of source, as ``SourceInfo.kind``, that show a simulated world.
SIMULATED_KINDS = ("simulated", "coppeliasim")


@dataclass(frozen=True)
class SourceInfo:
    """Facts that a source states about itself.

    Attributes:
        spec: the text it was opened by, as in ``simulated:lab``.
        kind: ``simulated``, ``stereo folder``, ``KITTI odometry``, ``KITTI raw``, ``EuRoC``,
            ``video``, ``camera``, ``network``, ``coppeliasim``, ``recording``; words shown to
            people.
        width, height: of each image, pixels.
        frame_rate: nominal, 1/s.
        frame_count: total number of frames, or None where it never ends, live or not.
        live: True where frames come at their own pace and cannot be paused.
        mount_height_m: height of the left camera above the ground, None where unknown.
        mount_tilt_rad: angle by which the camera looks down from the horizontal, None where
            unknown.
        mount_forward_m, mount_left_m: of the left camera from the middle of the axle about which
            the robot turns, None where unknown.
        devices: names by which the cameras of a live source are found again (left and right, or
            one that shows both images); empty for others. A calibration is bound to them.
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
    devices: tuple[str, ...] = ()

    @property
    def mount(self) -> CameraMount | None:
        """Mount of the left camera; None where height or tilt is unknown."""
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


@dataclass(frozen=True)
class NoFrame:
    """Answer of a live source that has no frame at this moment; ask again.

    Attributes:
        trouble: one sentence that names the camera and what is wrong with it; None while nothing
            is: the next frame is simply not due yet.
    """

    trouble: str | None = None


CameraSide = Literal["left", "right", "both"]
CameraState = Literal["open", "waiting", "failed"]


@dataclass(frozen=True)
class CameraReport:
    """State of one camera of a live source.

    Attributes:
        side: ``left``, ``right``, or ``both`` for one that shows both images.
        device: as in ``SourceInfo.devices``.
        state: ``open``, ``waiting`` (it is being opened again) or ``failed``.
        trouble: one sentence, None while it delivers.
        settings: the camera's current settings, in words by name, as in
            ``{"size": "640x480", "pixel format": "MJPG", "exposure": "156 (locked)"}``.
        refused: one sentence for each setting that was asked for and not accepted.
    """

    side: CameraSide
    device: str
    state: CameraState
    trouble: str | None
    settings: Mapping[str, str]
    refused: tuple[str, ...] = ()


@dataclass(frozen=True)
class LiveReport:
    """State of a live source.

    Attributes:
        cameras: one or two.
        pairs: delivered so far. dropped: pairs whose images were further apart than half a frame.
        skew_median_s, skew_p95_s: of ``|right_time - time|`` over the last seconds; None before
            enough pairs, and for one device that shows both images.
        reopened: how often a camera was opened again.
        hints: sentences for the person who sets it up, such as on shared USB bandwidth.
    """

    cameras: tuple[CameraReport, ...]
    pairs: int
    dropped: int
    skew_median_s: float | None
    skew_p95_s: float | None
    reopened: int
    hints: tuple[str, ...] = ()


@runtime_checkable
class LiveSource(Protocol):
    """Abilities of a live source besides delivering frames."""

    def tend(self) -> None:
        """Have the next pair decoded ahead; never waits.

        For the thread that reads, between two reads, as often as it likes: the cameras'
        processes decode while it observes.
        """
        ...

    def report(self) -> LiveReport:
        """Return its current state, at once; callable from any thread."""
        ...


@runtime_checkable
class SegmentedSource(Protocol):
    """Ability of a source to tell where a run was interrupted: a recording."""

    @property
    def begins(self) -> Literal["observer", "segment"] | None:
        """Return what restarted in the recorded run with the frame read last; None if nothing.

        ``segment`` stands for ``Observer.begin_segment``. What restarted with an unreadable frame
        is returned until a frame can be read.
        """
        ...


@runtime_checkable
class SeekableSource(SegmentedSource, Protocol):
    """Abilities of a source that can also jump between frames: a recording."""

    @property
    def position(self) -> int:
        """Position of the frame that ``read`` gives next, from 0 to ``SourceInfo.frame_count``.

        Frames that the run dropped are not counted, so it is not the frame's index.
        """
        ...

    def seek(self, position: int) -> None:
        """Have ``read`` give this frame next, within a few tens of milliseconds.

        Raises:
            SourceError: there is no such frame.
        """
        ...


@runtime_checkable
class SkippingSource(Protocol):
    """Ability of a source to skip frames faster than by reading them."""

    def skip(self, count: int) -> None:
        """Skip the next ``count`` frames."""
        ...


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

    def read(self) -> StereoFrame | SkippedFrame | NoFrame | None:
        """Return the next frame, a skipped frame with the reason, or None after the last one.

        A live source never waits longer than ``LIVE_PATIENCE_S`` and answers ``NoFrame`` when
        nothing came; it never ends by itself.
        """
        ...

    def rewind(self) -> None:
        """Go back to the first frame. Live sources raise SourceError."""
        ...

    def close(self) -> None:
        """Release files and devices; safe to call twice."""
        ...


def begins_segment(source: Source) -> bool:
    """Return true if the frame read last is unrelated to the one before in the recorded run."""
    return isinstance(source, SegmentedSource) and source.begins is not None
