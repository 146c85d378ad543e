"""Captures of one camera in its own process: V4L2 devices and network streams by OpenCV."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol, TypeAlias
from urllib.parse import urlsplit

import cv2
import numpy as np

from observer.errors import SourceError
from observer.image_files.reading import decoded_image
from observer.sources.cameras.settings import AppliedSettings, CameraSettings
from observer.types import Image

OPENER = "observer.sources.cameras.capture:open_capture"

# FFmpeg's own timeout; the source's is shorter and ends the process.
_TIMEOUT_MS = 5000
_PROBE_S = 2.0
# Packets are passed on as they come, none reordered or held back; RTSP over TCP, because a lost
# UDP packet gives a torn image that nothing marks as such.
_LOW_LATENCY = (
    "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay|max_delay;0|analyzeduration;2000000"
)
_DEFAULT_PORTS = {"http": 80, "https": 443, "rtsp": 554, "rtsps": 322}
# Codecs by MPEG-TS stream type, which a container may carry instead of a name.
_STREAM_TYPES = {0x1B: "H264", 0x24: "HEVC", 0x02: "MPEG2", 0x10: "MPEG4"}
# FFmpeg's AV_NOPTS_VALUE.
_NO_TIMESTAMP = -(2.0**63)
# A stamp outside this age is not on the host's monotonic clock.
_PLAUSIBLE_AGE_S = (-0.005, 2.0)


class Capture(Protocol):
    """Source of one camera's images. Any of its calls may hang; no other code may."""

    @property
    def rate(self) -> float | None:
        """Frames per second as the camera reports them; None where it does not."""
        ...

    def grab(self) -> bool:
        """Wait for the next frame and keep it undecoded; False where none came."""
        ...

    def stamp(self) -> float | None:
        """Exposure of the grabbed frame, seconds of ``time.monotonic``; None where unknown."""
        ...

    def sent(self) -> float | None:
        """Timestamp of the grabbed frame on the stream's own clock, seconds; None without any."""
        ...

    def settle(self) -> AppliedSettings:
        """Apply what can be set while it streams, and read back its settings; called once."""
        ...

    def retrieve(self) -> Image | None:
        """Decode the grabbed frame: (H, W) or (H, W, 3) uint8 BGR; None if it is not an image."""
        ...


Opener: TypeAlias = Callable[[str, CameraSettings], Capture]


def open_capture(address: str, settings: CameraSettings) -> Capture:
    """Open a device by its path or a stream by its URL.

    Raises:
        SourceError: its text continues a sentence that begins with the camera's name.
    """
    return NetworkCapture(address) if "://" in address else DeviceCapture(address, settings)


class _OpenCvCapture:
    """Base of captures by OpenCV, of devices and of streams."""

    _capture: cv2.VideoCapture

    @property
    def rate(self) -> float | None:
        # FFmpeg returns its time base, such as 90000, if the stream states no rate.
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        return rate if 0.5 <= rate <= 240.0 else None

    def grab(self) -> bool:
        return self._capture.grab()

    def retrieve(self) -> Image | None:
        try:
            good, image = self._capture.retrieve()
        except cv2.error:
            return None
        if not good or image is None or image.dtype.name != "uint8" or image.ndim not in (2, 3):
            return None
        pixels = np.asarray(image, np.uint8)
        if pixels.ndim == 3 and pixels.shape[2] == 1:
            pixels = pixels[:, :, 0]
        return pixels if pixels.size else None


class DeviceCapture(_OpenCvCapture):
    """A V4L2 device; implements ``Capture``.

    Its stamp is that of the kernel's buffer: OpenCV's V4L2 backend answers CAP_PROP_POS_MSEC with
    ``v4l2_buffer.timestamp``, which UVC gives on CLOCK_MONOTONIC, the clock of
    ``time.monotonic``.

    Raises:
        SourceError: it is missing, may not be opened or is in use.
    """

    def __init__(self, path: str, settings: CameraSettings) -> None:
        check_device(path)
        self._path = path
        self._wanted = settings
        # A by-path name is a link; its target changes when the camera is plugged in again.
        self._capture = cv2.VideoCapture(os.path.realpath(path), cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise SourceError(_in_use_or_no_camera(path))
        # The format first: sizes and rates depend on it.
        if settings.pixel_format is not None:
            code = cv2.VideoWriter.fourcc(*settings.pixel_format)
            self._capture.set(cv2.CAP_PROP_FOURCC, code)
        if settings.size is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.size[1])
        if settings.rate is not None:
            self._capture.set(cv2.CAP_PROP_FPS, settings.rate)
        self._stamped = True

    def stamp(self) -> float | None:
        stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        # Once found on another clock, stamps stay unused: their meaning must not change.
        self._stamped = self._stamped and is_monotonic_stamp(stamp, time.monotonic())
        return stamp if self._stamped else None

    def sent(self) -> float | None:
        return None

    def settle(self) -> AppliedSettings:
        # Loaded here because its ioctls exist on Linux only.
        from observer.sources.cameras.v4l2.applying import apply_settings

        return apply_settings(os.path.realpath(self._path), self._wanted)


class NetworkCapture(_OpenCvCapture):
    """A stream over RTSP or HTTP; implements ``Capture``. Its frames are stamped at arrival.

    Raises:
        SourceError: it cannot be reached or is not a video.
    """

    def __init__(self, url: str) -> None:
        with _ffmpeg_options(_LOW_LATENCY):
            # One thread: FFmpeg's frame threads hold back as many images as there are threads.
            self._capture = cv2.VideoCapture(
                url,
                cv2.CAP_FFMPEG,
                [
                    *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _TIMEOUT_MS),
                    *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, _TIMEOUT_MS),
                    *(cv2.CAP_PROP_N_THREADS, 1),
                ],
            )
        if not self._capture.isOpened():
            raise SourceError(_why_not(url))
        # FFmpeg's decoder fills what a truncated image lacks, and images of another size are scaled
        # to the first one's. Undecoded images also leave a queue faster.
        self._undecoded = _codec(self._capture) == "MJPG" and self._capture.set(
            cv2.CAP_PROP_FORMAT, -1
        )

    def retrieve(self) -> Image | None:
        received = super().retrieve()
        if received is None or not self._undecoded:
            return received
        try:
            return decoded_image(received.tobytes(), name="the image")
        except SourceError:
            return None

    def stamp(self) -> float | None:
        return None

    def sent(self) -> float | None:
        # Without timestamps, as of MJPEG, FFmpeg counts frames at a rate that it assumes.
        if self._capture.get(cv2.CAP_PROP_PTS) == _NO_TIMESTAMP:
            return None
        return self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3

    def settle(self) -> AppliedSettings:
        width = round(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = round(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        accepted = {"size": f"{width}x{height}"}
        codec = _codec(self._capture)
        if codec is not None:
            accepted["codec"] = codec
        accepted["timestamps"] = "none" if self.sent() is None else "of the stream"
        return AppliedSettings(accepted)


@contextlib.contextmanager
def _ffmpeg_options(options: str) -> Iterator[None]:
    """Set FFmpeg's options only while a stream is opened: with them, a video file loses frames."""
    name = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
    before = os.environ.get(name)
    os.environ[name] = options
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def is_monotonic_stamp(stamp: float, now: float) -> bool:
    """Return whether a frame that was grabbed now may have this stamp on the same clock, seconds.

    Some drivers stamp with the wall clock or with a counter of their own.
    """
    youngest, oldest = _PLAUSIBLE_AGE_S
    return youngest <= now - stamp <= oldest


def check_device(path: str) -> None:
    """Check that a device is there and may be opened.

    Raises:
        SourceError: its text continues a sentence that begins with the camera's name.
    """
    if sys.platform != "linux":
        raise SourceError("cannot be opened by a device path on this system; use Linux")
    real = Path(path).resolve()
    if not real.exists():
        raise SourceError("is not connected; plug it in or name another device")
    if not os.access(real, os.R_OK | os.W_OK):
        from observer.sources.cameras.device_files import permission_advice

        raise SourceError(f"cannot be opened: {permission_advice(real)}")


def _in_use_or_no_camera(path: str) -> str:
    from observer.sources.cameras.device_files import holders, in_words

    if who := in_words(holders(Path(path).resolve())):
        return f"is in use by {who}; close it"
    return (
        "cannot be used: it is open in another program or not a camera; close the other program or "
        "name another device"
    )


def _codec(capture: cv2.VideoCapture) -> str | None:
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    if code in _STREAM_TYPES:
        return _STREAM_TYPES[code]
    text = (code & 0xFFFFFFFF).to_bytes(4, "little").decode("latin-1").strip("\0 ")
    return text.upper() if text and text.isascii() and text.isprintable() else None


def _why_not(url: str) -> str:
    """Find out by connecting why a stream could not be opened, as FFmpeg does not say."""
    parts = urlsplit(url)
    port = parts.port or _DEFAULT_PORTS.get(parts.scheme.lower(), 80)
    try:
        with socket.create_connection((parts.hostname or "", port), timeout=_PROBE_S):
            pass
    except socket.gaierror:
        return "cannot be found; check the host name"
    except ConnectionRefusedError:
        return "refuses the connection; check that it is on and that the port is right"
    except TimeoutError:
        return "does not answer; check that it is on and reachable from this network"
    except OSError as error:
        return f"cannot be reached ({error.strerror or error}); check that it is on"
    return (
        "answers, but not with a video stream; check the path, user and password in its address, "
        "and that no other client is connected"
    )
