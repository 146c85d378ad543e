"""When things happened, for tools that know one clock alone."""

from __future__ import annotations

import numpy as np

from observer.recording.reader import Recording

_SECOND_NS = 1_000_000_000


class ExposureClock:
    """Nanoseconds since 1970 that pass as the source's clock does, from the first frame on.

    The wall clock at reception would do for live cameras, but not for what was observed faster or
    slower than it happened: speeds and paces by its stamps would be wrong. Where the source's
    clock goes back, it goes on from the wall clock, or from the frame before if that is later.

    Args:
        recording: with at least one frame.
    """

    def __init__(self, recording: Recording) -> None:
        anchor, frames = recording.facts.anchor, recording.frames
        wall = [anchor.wall_time_ns(frame.received) for frame in frames]
        stamps = [wall[0]]
        base_ns, base_time = wall[0], frames[0].time
        for k in range(1, len(frames)):
            if frames[k].time <= frames[k - 1].time:
                base_ns, base_time = max(wall[k], stamps[-1] + 1), frames[k].time
            stamps.append(base_ns + round((frames[k].time - base_time) * _SECOND_NS))
        self._wall = np.maximum.accumulate(np.array(wall, dtype=np.int64))
        self._stamps = np.array(stamps, dtype=np.int64)
        self._by_frame = {
            (frame.index, frame.time): stamp for frame, stamp in zip(frames, stamps, strict=True)
        }

    @property
    def begin_ns(self) -> int:
        """Of the first frame."""
        return int(self._stamps[0])

    def of_frame(self, index: int, time: float) -> int:
        """Of the frame with this number and time; of the last one where it was not recorded."""
        return self._by_frame.get((index, time), int(self._stamps[-1]))

    def of_wall(self, wall_ns: int) -> int:
        """Of an instant of the wall clock: that of a frame exactly if it was received then."""
        k = max(0, int(np.searchsorted(self._wall, wall_ns, side="right")) - 1)
        stamp = int(self._stamps[k]) + max(0, wall_ns - int(self._wall[k]))
        return stamp if k + 1 == len(self._stamps) else min(stamp, int(self._stamps[k + 1]))
