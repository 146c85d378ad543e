"""Writer of MP4 video: H.264, which browsers play, by ffmpeg where it is installed.

Without ffmpeg OpenCV's own encoder makes MPEG-4 (``mp4v``), which players show but browsers do not.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import IO, Protocol

import cv2
import numpy as np

from observer.exporting.errors import ExportError
from observer.types import Image

H264 = "H.264"
MPEG4 = "MPEG-4 (mp4v), which browsers cannot play; install ffmpeg to get H.264"
# CRF of H.264, lower is better: text stays sharp at this value.
_QUALITY = 20
_PATIENCE_S = 60.0
# Frames per second of a video of a source whose frame rate is unknown.
FALLBACK_RATE = 15.0
# Longest pause of the source that is shown in real time.
_LONGEST_STILL_S = 5.0


class _Encoder(Protocol):
    """Takes BGR pictures of one even size."""

    def write(self, picture: Image) -> None: ...
    def finish(self) -> None: ...
    def abort(self) -> None: ...


class OverlayVideo:
    """A video at a constant rate that shows each picture at its own time.

    The first picture sets the size, and later ones must have the same. An odd width or height
    loses a line, since video needs even ones. Frames missing in the source are filled with the
    previous picture, so that the video runs in real time.

    Args:
        path: of the file; written as pictures come.
        frame_rate: 1/s.
        ffmpeg: path of the program, None for OpenCV's encoder; searched for if left out.

    Attributes:
        pictures: number written to the file so far.

    Raises:
        ExportError: the file cannot be written; all methods may raise it.
    """

    def __init__(self, path: Path, frame_rate: float, *, ffmpeg: str | None = "") -> None:
        self._path = path
        # A fraction that containers can store, such as 30000/1001.
        self._rate = Fraction(frame_rate).limit_denominator(1001)
        if self._rate <= 0:
            raise ExportError(f"a video needs a frame rate above 0, not {frame_rate:g}")
        self._ffmpeg = find_ffmpeg() if ffmpeg == "" else ffmpeg
        self._encoder: _Encoder | None = None
        self.pictures = 0
        self._shift = 0.0
        self._begin: float | None = None
        self._last: Image | None = None

    @property
    def codec(self) -> str:
        """Name of the codec, for people."""
        return MPEG4 if self._ffmpeg is None else H264

    def add(self, picture: Image, time: float) -> None:
        """Show this picture from ``time`` on.

        Args:
            picture: (H, W, 3) BGR. time: seconds on the source's clock; after a jump back or a
                long pause the picture follows immediately.
        """
        height, width = (side - side % 2 for side in picture.shape[:2])
        even = np.ascontiguousarray(picture[:height, :width])
        if self._encoder is None:
            target = self._path, width, height, self._rate
            self._encoder = (
                _OpenCv(*target) if self._ffmpeg is None else _Ffmpeg(self._ffmpeg, *target)
            )
        if self._begin is None or self._last is None:
            self._begin = time
        else:
            due = round((time - self._begin + self._shift) * self._rate)
            missing = due - self.pictures
            if not -self._rate <= missing <= _LONGEST_STILL_S * self._rate:
                self._shift -= missing / float(self._rate)
                missing = 0
            for _ in range(missing):
                self._write(self._last)
        self._write(even)
        self._last = even

    def finish(self) -> None:
        """Complete the file.

        Raises:
            ExportError: there was no picture, or the encoder failed.
        """
        encoder, self._encoder = self._encoder, None
        if encoder is None:
            raise ExportError("there are no frames to make a video of")
        encoder.finish()

    def abort(self) -> None:
        """Stop the encoder without completing the file; safe after ``finish``."""
        encoder, self._encoder = self._encoder, None
        if encoder is not None:
            encoder.abort()

    def _write(self, picture: Image) -> None:
        assert self._encoder is not None
        self._encoder.write(picture)
        self.pictures += 1


def find_ffmpeg() -> str | None:
    """Return the path of ffmpeg if it is installed and can encode H.264, else None."""
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        return None
    try:
        known = subprocess.run(
            [ffmpeg, "-hide_banner", "-encoders"],
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=_PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return ffmpeg if b"libx264" in known.stdout else None


class _Ffmpeg:
    def __init__(self, ffmpeg: str, path: Path, width: int, height: int, rate: Fraction) -> None:
        self._path = path
        # Its messages go to a file, because a full pipe that nobody reads would block it.
        self._said: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        arguments = [
            ffmpeg, "-hide_banner", "-loglevel", "error", "-y",
            "-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{width}x{height}",
            "-r", f"{rate.numerator}/{rate.denominator}", "-i", "pipe:0",
            "-c:v", "libx264", "-preset", "veryfast", "-crf", str(_QUALITY),
            # A pixel format that browsers play, and the index first, to play while loading.
            "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4",
            f"file:{path.absolute()}",
        ]  # fmt: skip
        try:
            self._process = subprocess.Popen(
                arguments,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._said,
                # Keep Ctrl-C away from it: we handle it, and ffmpeg ends with its input.
                start_new_session=True,
            )
        except OSError as error:
            self._said.close()
            raise ExportError(f"ffmpeg cannot be started: {error.strerror}") from None

    def write(self, picture: Image) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(picture.data)
        except OSError:
            self._close()
            raise self._failure() from None

    def finish(self) -> None:
        self._close()
        if self._process.returncode != 0:
            raise self._failure()
        self._said.close()

    def abort(self) -> None:
        self._process.kill()
        self._close()
        self._said.close()

    def _close(self) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _failure(self) -> ExportError:
        self._said.seek(0)
        said = self._said.read().decode(errors="replace").strip().splitlines()
        self._said.close()
        why = said[-1] if said else f"exit code {self._process.returncode}"
        return ExportError(f"the video {self._path} cannot be written: ffmpeg says {why}")


class _OpenCv:
    def __init__(self, path: Path, width: int, height: int, rate: Fraction) -> None:
        self._path = path
        # OpenCV chooses the container by the suffix.
        self._working = path.with_name(f"{path.name}.mp4")
        code = cv2.VideoWriter.fourcc(*"mp4v")
        self._writer = cv2.VideoWriter(str(self._working), code, float(rate), (width, height))
        if not self._writer.isOpened():
            raise ExportError(
                f"the video {path} cannot be written; name a file in an existing, writable folder"
            )

    def write(self, picture: Image) -> None:
        self._writer.write(picture)

    def finish(self) -> None:
        self._writer.release()
        os.replace(self._working, self._path)

    def abort(self) -> None:
        self._writer.release()
        self._working.unlink(missing_ok=True)
