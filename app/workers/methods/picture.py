"""Picture of what the methods find at the moment, for who waits."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from observer.camera import StereoCalibration
from observer.exporting.overlay import draw_overlay
from observer.jsonl import ObservationLine
from observer.types import StereoFrame
from observer.vision.rectification import Rectification

_EVERY_S = 0.4
_WIDTH, _QUALITY = 1280, 75


class MethodsPicture:
    """JPEG of the newest frame with what each method found, side by side.

    Args:
        path: of the file, which is replaced a few times a second.
    """

    def __init__(self, path: Path, calibration: StereoCalibration) -> None:
        self._path = path
        self._rectification = Rectification(calibration)
        self._shown: float | None = None

    def show(self, frame: StereoFrame, lines: Sequence[ObservationLine]) -> None:
        """Replace the picture, if it is time to."""
        now = time.monotonic()
        if self._shown is not None and now - self._shown < _EVERY_S:
            return
        self._shown = now
        left, _ = self._rectification.apply(frame.left, frame.right)
        both = np.hstack([draw_overlay(left, line) for line in lines])
        if both.shape[1] > _WIDTH:
            size = _WIDTH, round(both.shape[0] * _WIDTH / both.shape[1])
            resized = cv2.resize(both, size, interpolation=cv2.INTER_AREA)
            both = np.asarray(resized, dtype=np.uint8)
        _, jpeg = cv2.imencode(".jpg", both, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        # Whoever reads it finds a whole one.
        part = self._path.with_suffix(".part")
        part.write_bytes(jpeg.tobytes())
        part.replace(self._path)
