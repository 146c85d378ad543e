"""Video files: one for each camera, or one with both images side by side."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from observer.calibration.formats.opencv_file import read_noted_calibration
from observer.camera import StereoCalibration
from observer.errors import SourceError
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.sources.file_pairs import check_size
from observer.types import Image, StereoFrame

# Frames read at opening to see whether the container's time stamps can be used.
_PROBED_FRAMES = 5
# The container's frame count is an estimate; one frame more or less is normal.
_COUNT_TOLERANCE = 1


def open_video(spec: str) -> VideoSource:
    """Open ``LEFT,RIGHT`` or ``SIDE_BY_SIDE`` (left image in the left half).

    Raises:
        SourceError: a file is missing, is not a video, or the two do not belong together.
        CalibrationError: the ``calibration.yaml`` next to the (left) file is unusable.
    """
    if not spec.strip():
        raise SourceError("video: needs a file, as in video:left.mp4,right.mp4")
    paths = [Path(spec)] if Path(spec).is_file() else [Path(p.strip()) for p in spec.split(",")]
    if len(paths) > 2:
        raise SourceError(
            "video: takes two files separated by a comma or one side-by-side file, not "
            f"{len(paths)}"
        )
    return VideoSource(paths, spec=f"video:{spec}")


class VideoSource:
    """Plays one or two video files; implements ``Source``.

    Times are the container's own where they rise in step with its frame rate, otherwise the
    frame's number over the rate. Frames that only one file has are skipped, and a file that ends
    before its announced number of frames is reported once, at its end.

    Args:
        paths: the left and right file, or one side-by-side file.
        spec: the text it was opened by.

    Attributes:
        calibration: from a ``calibration.yaml`` beside the (left) file; None without one.
        calibration_notes: what was decided while it was read, one sentence each.

    Raises:
        SourceError, CalibrationError: as ``open_video``.
    """

    def __init__(self, paths: list[Path], *, spec: str) -> None:
        self._paths = paths
        probes = [_probe(path) for path in paths]
        first = probes[0]
        for path, probe in zip(paths[1:], probes[1:], strict=True):
            _check_belongs(paths[0], first, path, probe)
        if len(paths) == 1 and first.width % 2:
            raise SourceError(
                f"{paths[0].name} is {first.width} pixels wide; a side-by-side video needs an even "
                "width (give two videos as LEFT,RIGHT)"
            )
        self._stamped = all(probe.stamped for probe in probes)
        self._rate = first.rate
        counts = [probe.count for probe in probes]
        self._announced = max(counts) if all(counts) else None
        self.info = SourceInfo(
            spec=spec,
            kind="video",
            width=first.width // 2 if len(paths) == 1 else first.width,
            height=first.height,
            frame_rate=first.rate,
            frame_count=self._announced,
        )
        self.calibration, self.calibration_notes = _calibration_beside(paths[0], self.info)
        self._captures: list[cv2.VideoCapture] = []
        self._last_time, self._ended = -math.inf, False
        self.rewind()

    def read(self) -> StereoFrame | SkippedFrame | None:
        if self._ended:
            return None
        images = [_next_image(capture) for capture in self._captures]
        index = self._index
        if all(image is None for image in images):
            return self._end(index)
        self._index += 1
        if any(image is None for image in images):
            ended = self._paths[0 if images[0] is None else 1]
            return SkippedFrame(
                index, f"{ended.name} ends before frame {index}; the other video is longer"
            )
        present = [image for image in images if image is not None]
        left, right = present if len(present) == 2 else _halves(present[0])
        for image, side in ((left, "left"), (right, "right")):
            if image.shape[:2] != (self.info.height, self.info.width):
                return SkippedFrame(
                    index,
                    f"frame {index} is {image.shape[1]}x{image.shape[0]} pixels on the {side}, "
                    f"but the video started with {self.info.width}x{self.info.height}",
                )
        now = self._time(index)
        if now <= self._last_time:
            return SkippedFrame(
                index, f"frame {index} has the time {now:g} s, not later than the one before"
            )
        self._last_time = now
        return StereoFrame(index=index, time=now, left=left, right=right, received=time.monotonic())

    def rewind(self) -> None:
        """Go back to the first frame by reopening the files, as seeking is inexact."""
        self.close()
        self._captures = [_open(path) for path in self._paths]
        self._index = 0
        self._last_time = -math.inf
        self._ended = False

    def close(self) -> None:
        """Release the files; safe to call twice."""
        for capture in self._captures:
            capture.release()
        self._captures = []
        self._ended = True

    def _time(self, index: int) -> float:
        if self._stamped:
            return float(self._captures[0].get(cv2.CAP_PROP_POS_MSEC)) / 1000
        return index / self._rate

    def _end(self, index: int) -> SkippedFrame | None:
        self._ended = True
        announced = self._announced
        if announced is None or index + _COUNT_TOLERANCE >= announced:
            return None
        names = " and ".join(path.name for path in self._paths)
        return SkippedFrame(
            index,
            f"{names} should have {announced} frames but ends after {index}: the rest is missing "
            "or damaged",
        )


@dataclass(frozen=True)
class _Probe:
    """Facts that a video file states; ``count`` is 0 if it states none."""

    width: int
    height: int
    rate: float
    count: int
    stamped: bool


def _probe(path: Path) -> _Probe:
    capture = _open(path)
    try:
        count = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        stamps: list[float] = []
        image = None
        while len(stamps) < _PROBED_FRAMES and (following := _next_image(capture)) is not None:
            image = following if image is None else image
            stamps.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000)
    finally:
        capture.release()
    if image is None or len(stamps) < 2:
        raise SourceError(
            f"fewer than two frames of {path} can be decoded; it is truncated or not a video"
        )
    rate_known = math.isfinite(rate) and 0 < rate <= 1000
    steps = np.diff(stamps)
    stamped = bool(np.isfinite(stamps).all() and (steps > 0).all() and stamps[0] >= 0)
    if stamped and rate_known:
        # Stamps far from the announced rate come from a container that keeps none.
        stamped = 0.5 <= float(np.mean(steps)) * rate <= 2
    if not rate_known:
        if not stamped:
            raise SourceError(
                f"{path.name} contains neither a frame rate nor frame times; convert it to a "
                "container that does, such as MP4 or Matroska"
            )
        rate = 1 / float(np.median(steps))
    return _Probe(
        width=image.shape[1],
        height=image.shape[0],
        rate=rate,
        count=int(count) if math.isfinite(count) and 0 < count < 1e9 else 0,
        stamped=stamped,
    )


def _check_belongs(left_path: Path, left: _Probe, right_path: Path, right: _Probe) -> None:
    if (left.width, left.height) != (right.width, right.height):
        raise SourceError(
            f"{left_path.name} is {left.width}x{left.height} pixels and {right_path.name} "
            f"{right.width}x{right.height}; both videos must have the same image size"
        )
    if abs(left.rate - right.rate) > 0.01 * left.rate:
        raise SourceError(
            f"{left_path.name} has {left.rate:g} fps and {right_path.name} {right.rate:g} fps; "
            "both must have the same frame rate"
        )


def _open(path: Path) -> cv2.VideoCapture:
    if not path.is_file():
        raise SourceError(f"there is no video file {path}")
    # FFmpeg explicitly: other backends take a file's name for an image pattern or a device.
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        capture.release()
        raise SourceError(f"{path} is truncated or not a video that FFmpeg can read")
    return capture


def _next_image(capture: cv2.VideoCapture) -> Image | None:
    ok, image = capture.read()
    return np.asarray(image, dtype=np.uint8) if ok else None


def _halves(image: Image) -> tuple[Image, Image]:
    middle = image.shape[1] // 2
    # Copies, because a view with gaps between its rows slows every later stage.
    return image[:, :middle].copy(), image[:, middle:].copy()


def _calibration_beside(
    path: Path, info: SourceInfo
) -> tuple[StereoCalibration | None, tuple[str, ...]]:
    file = path.parent / "calibration.yaml"
    if not file.is_file():
        return None, ()
    calibration, notes = read_noted_calibration(file)
    check_size(calibration, info.width, info.height, name=str(file), images="the video's")
    return calibration, notes
