"""Two live cameras, or one that shows both images, as a source."""

from __future__ import annotations

import contextlib
import select
import subprocess
import time
from collections.abc import Sequence

from observer.camera import StereoCalibration
from observer.errors import SourceError
from observer.sources.cameras.capture import OPENER
from observer.sources.cameras.live_camera import LiveCamera
from observer.sources.cameras.messages import Grabbed
from observer.sources.cameras.pairing import Skews, judge
from observer.sources.cameras.spec import CamerasSpec
from observer.sources.cameras.usb import bandwidth_hints
from observer.sources.contract import (
    LIVE_PATIENCE_S,
    CameraSide,
    LiveReport,
    NoFrame,
    SourceInfo,
)
from observer.types import Image, StereoFrame

_OPENING_S = 15.0
# A device released a moment ago is still busy, and a stream may just be starting.
_OPENING_FAILURES = 3
# Longest time between two polls while a read waits.
_GLANCE_S = 0.01
_UNATTENDED_S = 1.0
_PAIRLESS_S = 0.16
_PAIRLESS_PERIODS = 2.5
# A frame about to be replaced would be gone before the command arrives.
_HASTE_S = 0.002
_REAPING_S = 1.0
# A pair decoded ahead is followed by the next within a period plus the decoding time.
_OLD_PERIODS = 1.5


class CameraSource:
    """Live cameras; implements ``Source`` and ``LiveSource``.

    Each camera has a process of its own (``grabber``). Neither frame of a pair is decoded before
    both are there; frames more than half a period apart are never decoded. All decisions are made
    in calls of ``read`` or ``tend``; no thread is needed.

    Args:
        spec: what to open.
        opener: as in ``messages.Open``; tests replace OpenCV's cameras by it.

    Raises:
        SourceError: a camera is missing, cannot be opened or delivers no pair within 15 s; one
            sentence that names the camera.
    """

    # Cameras come with none.
    calibration: StereoCalibration | None = None

    def __init__(self, spec: CamerasSpec, *, opener: str = OPENER) -> None:
        self._spec = spec
        self._skews = Skews()
        self._index = 0
        self._pairs = 0
        self._dropped = 0
        self._last_time: float | None = None
        self._left_out = False
        self._reported: str | None = None
        self._closed = False
        self._ahead = False
        now = time.monotonic()
        self._last_read = now
        self._pairless_since = now
        sides: tuple[CameraSide, ...] = ("left", "right")
        self._cameras = [
            LiveCamera(side, target, spec.settings, opener, now)
            for side, target in zip(
                sides if len(spec.targets) == 2 else ("both",), spec.targets, strict=True
            )
        ]
        try:
            self.info = self._open()
        except BaseException:
            self.close()
            raise
        self._hints = () if spec.network else self._bandwidth_hints()
        self._index = self._pairs = self._dropped = 0

    def read(self) -> StereoFrame | NoFrame:
        """Return the next pair, or what keeps it from coming.

        Raises:
            SourceError: it was closed.
        """
        if self._closed:
            raise SourceError("the cameras are closed; reopen the source")
        now = time.monotonic()
        deadline = now + LIVE_PATIENCE_S
        if now - self._last_read > _UNATTENDED_S:
            self._pairless_since = now
            for camera in self._cameras:
                camera.attend(now)
        while True:
            for camera in self._cameras:
                camera.poll(now)
            if self._ahead:
                # Only once, or cameras that are faster than the decoding would never be read.
                self._ahead = False
                self._ask(now)
                self._leave_old(now)
            frame = self._decide(now)
            if frame is not None:
                self._reported = None
                self._last_read = now
                return frame
            trouble = self._trouble(now)
            if now >= deadline or (trouble is not None and trouble != self._reported):
                self._reported = trouble
                self._last_read = now
                return NoFrame(trouble)
            self._wait(min(deadline - now, _GLANCE_S))
            now = time.monotonic()

    def tend(self) -> None:
        """Have the newest pair decoded while there is other work to do; never waits.

        For the thread that reads, every few milliseconds between two reads: ``read`` then finds
        the pair decoded. A pair that was not read gives way to the next one, so that ``read``
        still returns the newest. Without calls of ``tend``, ``read`` waits for the decoding.
        """
        if self._closed:
            return
        now = time.monotonic()
        for camera in self._cameras:
            camera.poll(now)
        self._ahead = True
        self._ask(now)

    def rewind(self) -> None:
        """Raise SourceError: live cameras cannot go back."""
        raise SourceError("live cameras cannot be rewound; record a run to play it again")

    def report(self) -> LiveReport:
        """Return the cameras' current state; callable from any thread."""
        median, p95 = self._skews.median_and_p95()
        return LiveReport(
            cameras=tuple(camera.report() for camera in self._cameras),
            pairs=self._pairs,
            dropped=self._dropped,
            skew_median_s=median,
            skew_p95_s=p95,
            reopened=sum(max(0, camera.openings - 1) for camera in self._cameras),
            hints=self._hints,
        )

    def close(self) -> None:
        """End the cameras' processes; safe to call twice."""
        self._closed = True
        dying = [child for camera in self._cameras for child in camera.close()]
        deadline = time.monotonic() + _REAPING_S
        for child in dying:
            # A process that hangs in the kernel ends when the kernel releases it.
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(max(0.0, deadline - time.monotonic()))

    def _decide(self, now: float) -> StereoFrame | None:
        """Pair the pending frames, and return a pair once it is decoded."""
        if any(camera.decoding is not None for camera in self._cameras):
            return self._collect()
        self._ask(now)
        return None

    def _ask(self, now: float) -> None:
        """Have the pending frames decoded if they are a pair; a pair decoded before gives way."""
        if any(each.decoding is not None and not each.is_decoded for each in self._cameras):
            # The next image would go to the same memory.
            return
        pending = [camera.pending for camera in self._cameras]
        left, right = pending[0], pending[-1]
        if left is None or right is None or now > min(left.until, right.until) - _HASTE_S:
            return
        if len(pending) == 1:
            self._cameras[0].decode()
            return
        period = min(camera.period.seconds for camera in self._cameras)
        match judge(left.stamp, right.stamp, period):
            case "pair":
                for camera in self._cameras:
                    camera.decode()
            case "drop left":
                self._drop(left, self._cameras[0], self._cameras[1], period)
            case "drop right":
                self._drop(right, self._cameras[1], self._cameras[0], period)

    def _leave_old(self, now: float) -> None:
        """Drop a pair decoded ahead if newer ones came meanwhile and were missed."""
        period = min(camera.period.seconds for camera in self._cameras)
        for camera in self._cameras:
            if camera.decoding is None or not camera.is_decoded:
                return
            if now - camera.decoding.arrival <= _OLD_PERIODS * period:
                return
        for camera in self._cameras:
            camera.release()

    def _drop(self, older: Grabbed, own: LiveCamera, other: LiveCamera, period: float) -> None:
        own.drop()
        # No dropped pair if the frame's partner came and went while the observer was busy.
        if not any(judge(older.stamp, stamp, period) == "pair" for stamp in other.recent):
            self._dropped += 1
            self._index += 1

    def _collect(self) -> StereoFrame | None:
        """Return the pair if both images are decoded."""
        cameras = self._cameras
        if any(camera.decoding is None for camera in cameras):
            # One image was lost, and the other is of no use without it. An image that is still
            # being decoded must be waited for: the next one uses the same memory.
            for camera in cameras:
                if camera.is_decoded:
                    camera.release()
            return None
        if not all(camera.is_decoded for camera in cameras):
            return None
        left, right = cameras[0].decoding, cameras[-1].decoding
        assert left is not None
        assert right is not None
        frame = None
        is_news = self._last_time is None or left.stamp > self._last_time
        if is_news and not self._repeats(cameras):
            both = len(cameras) == 1
            received = max(left.received, right.received)
            if not self._pairs:
                # The first pair may come together with the sizes that the cameras opened with.
                self._check_sizes()
            left_image, right_image = self._images()
            frame = StereoFrame(
                index=self._index,
                time=left.stamp,
                left=left_image,
                right=right_image,
                received=received,
                right_time=None if both else right.stamp,
            )
            if not both:
                self._skews.add(received, right.stamp - left.stamp)
            self._last_time = left.stamp
            self._index += 1
            self._pairs += 1
            self._pairless_since = max(left.arrival, right.arrival)
            for camera in cameras:
                camera.recovered()
        for camera in cameras:
            camera.release()
        return frame

    def _repeats(self, cameras: Sequence[LiveCamera]) -> bool:
        """Return whether the pair repeats the one before: a robot must not drive by it.

        A single repeated pair is left out; more of them are a fault. The pair after one that was
        left out counts as new, so that two cameras that repeat in turn still deliver.
        """
        self._left_out = not self._left_out and any(camera.repeats for camera in cameras)
        return self._left_out or any(camera.is_frozen for camera in cameras)

    def _images(self) -> tuple[Image, Image]:
        """Return copies, as the next pair overwrites the memory."""
        if len(self._cameras) == 2:
            return self._cameras[0].image.copy(), self._cameras[1].image.copy()
        both = self._cameras[0].image
        half = both.shape[1] // 2
        first, second = both[:, :half].copy(), both[:, half:].copy()
        return (second, first) if self._spec.swapped else (first, second)

    def _trouble(self, now: float) -> str | None:
        troubles = [trouble for each in self._cameras if (trouble := each.trouble(now))]
        if troubles:
            return "; ".join(troubles)
        period = min(camera.period.seconds for camera in self._cameras)
        if now - self._pairless_since <= max(_PAIRLESS_S, _PAIRLESS_PERIODS * period):
            return None
        left, right = self._cameras[0], self._cameras[-1]
        if self._last_time is not None and left.recent and left.recent[-1] <= self._last_time:
            return f"{left} sends images whose timestamps go backwards"
        # If some frames match, the observer was merely too late for them.
        if any(judge(a, b, period) == "pair" for a in left.recent for b in right.recent):
            return None
        return (
            f"{left} and {right} deliver no images within half a frame of each other; set both to "
            "the same frame rate"
        )

    def _wait(self, seconds: float) -> None:
        """Wait until a camera has something to report, at most ``seconds``."""
        poll = select.poll()
        for camera in self._cameras:
            if camera.wakes is not None:
                poll.register(camera.wakes, select.POLLIN)
        poll.poll(max(1.0, seconds * 1e3))

    def _open(self) -> SourceInfo:
        deadline = time.monotonic() + _OPENING_S
        while True:
            item = self.read()
            now = time.monotonic()
            for camera in self._cameras:
                if camera.is_missing or camera.failures >= _OPENING_FAILURES:
                    raise SourceError(camera.trouble(now) or f"{camera} cannot be opened")
            self._check_sizes()
            if isinstance(item, StereoFrame):
                rates = [self._rate(camera) for camera in self._cameras]
                known = [rate for rate in rates if rate is not None]
                if len(known) == len(rates):
                    return SourceInfo(
                        spec=self._spec.text,
                        kind="network" if self._spec.network else "camera",
                        width=item.left.shape[1],
                        height=item.left.shape[0],
                        frame_rate=min(known),
                        frame_count=None,
                        live=True,
                        devices=tuple(target.name for target in self._spec.targets),
                    )
            if now > deadline:
                raise SourceError(
                    self._trouble(now)
                    or f"{self._spec.text} delivered no image pair within {_OPENING_S:g} s; "
                    "check that the cameras are on"
                )

    def _check_sizes(self) -> None:
        left, right = self._cameras[0], self._cameras[-1]
        first, second = left.opened, right.opened
        if first is None or second is None:
            return
        if (first.width, first.height) != (second.width, second.height):
            raise SourceError(
                f"{left} delivers {first.width}x{first.height} pixels and {right} "
                f"{second.width}x{second.height}; set both to the same size"
            )
        if left.side == "both" and first.width % 2:
            raise SourceError(
                f"{left} delivers {first.width} pixels across; a side-by-side image needs an even "
                "width"
            )

    @staticmethod
    def _rate(camera: LiveCamera) -> float | None:
        """Return a device's nominal or a stream's measured rate: FFmpeg may invent 25/s."""
        said = None if camera.opened is None or camera.target.network else camera.opened.rate
        if said is not None:
            return said
        return round(1.0 / camera.period.seconds, 1) if camera.period.settled else None

    def _bandwidth_hints(self) -> tuple[str, ...]:
        if len(self._cameras) < 2:
            return ()
        opened = self._cameras[0].opened
        return bandwidth_hints(
            [camera.target.address for camera in self._cameras],
            width=self.info.width,
            height=self.info.height,
            rate=self.info.frame_rate,
            pixel_format=None if opened is None else opened.settings.get("pixel format"),
        )
