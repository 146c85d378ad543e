"""Picture of the methods' current results, shown while a comparison runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from observer.camera import StereoCalibration
from observer.exporting.overlay import draw_overlay
from observer.image_files.jpeg import encode_jpeg
from observer.jsonl import ObservationLine
from observer.types import StereoFrame
from observer.vision.rectification import Rectification
from observer.whole_files import whole_file

_EVERY_S = 0.4
_WIDTH, _QUALITY = 1280, 75


class MethodsPicture:
    """JPEG of the newest frame with each method's result, side by side.

    Args:
        path: path of the file, which is replaced a few times a second.
    """

    def __init__(self, path: Path, calibration: StereoCalibration) -> None:
        self._path = path
        self._rectification = Rectification(calibration)
        self._shown: float | None = None

    def show(self, frame: StereoFrame, lines: Sequence[ObservationLine]) -> None:
        """Replace the picture if an update is due."""
        now = time.monotonic()
        if self._shown is not None and now - self._shown < _EVERY_S:
            return
        self._shown = now
        left = self._rectification.apply_left(frame.left)
        both = np.hstack([draw_overlay(left, line) for line in lines])
        with whole_file(self._path) as part:
            part.write_bytes(encode_jpeg(both, _QUALITY, most_width=_WIDTH))
