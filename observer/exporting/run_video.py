"""Video of a run: its results drawn over the recorded images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from observer.errors import SourceError
from observer.exporting.errors import ExportError
from observer.exporting.overlay import draw_overlay
from observer.exporting.video import FALLBACK_RATE, OverlayVideo
from observer.recording.reader import Recording
from observer.recording.run_times import RunTimes
from observer.vision.rectification import Rectification

# Players and encoders refuse rates outside these.
_SLOWEST, _FASTEST = 1.0, 240.0


def write_run_video(
    recording: Recording,
    path: Path,
    progress: Callable[[int, int | None], None] | None = None,
) -> OverlayVideo:
    """Write the overlay video of a run, at the rate of its frames.

    Args:
        progress: called with the number of frames done and their total.

    Returns:
        The finished video, which knows its codec.

    Raises:
        ExportError: the recording holds no images, or the file cannot be written.
    """
    if not recording.images_held:
        raise ExportError(
            f"{recording.path.name} was recorded without images, so no video can be made; record "
            "with jpeg or lossless images"
        )
    rectified = Rectification(recording.calibration())
    count, times = len(recording.frames), RunTimes(recording.frames).frames
    video = OverlayVideo(path, frame_rate(recording))
    try:
        for done, (position, line) in enumerate(recording.positioned_lines(), 1):
            if position is not None:
                try:
                    left = rectified.apply_left(recording.pair(position)[0])
                except SourceError:
                    # Its images were lost; the previous picture stays.
                    continue
                video.add(draw_overlay(left, line), times[position][1])
            if progress is not None:
                progress(done, count)
        video.finish()
    finally:
        video.abort()
    return video


def frame_rate(recording: Recording) -> float:
    """Return the frame rate of a run, 1/s, from the median interval of its frames."""
    times = np.array([frame.time for frame in recording.frames])
    steps = np.diff(times)
    steps = steps[steps > 0]
    rate = 1 / float(np.median(steps)) if len(steps) else FALLBACK_RATE
    return min(max(rate, _SLOWEST), _FASTEST)
